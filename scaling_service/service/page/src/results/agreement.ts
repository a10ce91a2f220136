/** How methods agree with what images show: bias, limits of agreement, intraclass correlation. */

import type { AgreementEntry, StatisticsDocument } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawIntervals } from "../charts/intervals.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { number, words } from "../ui/words.ts";

export function agreement({ agreement: entries }: StatisticsDocument, signal: AbortSignal, place: HTMLElement): void {
  if (entries.length === 0) {
    place.append(h("p", null, "No method rests on images here, so there is nothing to agree with."));
    return;
  }
  place.append(picture(entries.filter(({ quantity }) => !quantity.includes(".")), signal), table({
    caption: `Against ${[...new Set(entries.map(({ reference }) => reference))].join(", ")}, mm`,
    name: "agreement",
    columns: ["quantity", "method", "subjects", "bias", "95 % interval", "limits of agreement", "RMSE", "ICC(2,1)"].map((title) => ({ title })),
    rows: entries.map(row),
    filter: true,
    note: "Bias: mean of method minus reference. Limits of agreement: bias ± 1.96 SD.",
  }));
}

/** Bias and limits of agreement of the lengths. */
function picture(entries: readonly AgreementEntry[], signal: AbortSignal): HTMLElement {
  const known = styles(entries.map(({ method }) => method));
  const intervals = entries.map(({ quantity, method, lower_mm, bias_mm, upper_mm }) => ({
    name: `${words(quantity)}: ${method}`, low: lower_mm.value, middle: bias_mm.value, high: upper_mm.value, colour: known.get(method)?.colour ?? "" }));
  return figure({
    title: "Segment lengths: bias and limits of agreement, mm",
    name: "agreement_mm",
    alt: intervals.map(({ name, low, middle, high }) => `${name} ${number(middle)} (${number(low)} to ${number(high)})`).join("; "),
    height: Math.max(150, 70 + 18 * intervals.length),
    drawing: (ink) => drawIntervals(ink, intervals, "method minus reference, mm"),
    rows: () => [["quantity", "low_mm", "bias_mm", "high_mm"], ...intervals.map((one) => [one.name, one.low, one.middle, one.high])],
  }, signal).element;
}

function row(entry: AgreementEntry): Cell[] {
  const { bias_mm: bias, lower_mm, upper_mm, rmse_mm, icc_agreement: icc } = entry;
  return [
    cell(words(entry.quantity.replace(/\.([xyz])$/, ", $1"))),
    cell(entry.method),
    cell(String(entry.subjects.length), entry.subjects.length),
    cell(number(bias.value), bias.value),
    cell(bias.low === null ? "–" : `${number(bias.low)} to ${number(bias.high)}`),
    cell(`${number(lower_mm.value)} to ${number(upper_mm.value)}`, lower_mm.value),
    cell(number(rmse_mm), rmse_mm),
    cell(number(icc?.value, 2), icc?.value ?? null),
  ];
}
