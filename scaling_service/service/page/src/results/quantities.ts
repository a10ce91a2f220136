/** One number for each subject and method: means, tests, and a picture of all. */

import type { QuantityEntry, StatisticsDocument } from "../api/schema.ts";
import { drawDots } from "../charts/dots.ts";
import { figure } from "../charts/figure.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { chance, number, signed, words } from "../ui/words.ts";
import { methodColumns } from "./verdict.ts";

const QUANTITIES = [
  ["kinematic_error_mm", "Kinematic error", "mm"],
  ["segment_lengths_mm", "Segment length", "mm"],
  ["knee_axis_deg", "Turn of the knee axis", "deg"],
  ["marker_shift_mm", "Marker shift", "mm"],
  ["from_truth_mm", "Distance from the truth", "mm"],
  ["from_truth_deg", "Distance from the truth", "deg"],
] as const;

type Key = (typeof QUANTITIES)[number][0];

export function quantities(statistics: StatisticsDocument, keys: readonly Key[], signal: AbortSignal, place: HTMLElement): void {
  for (const [key, title, unit] of QUANTITIES) {
    const entries = statistics[key].filter(({ mean }) => Object.keys(mean).length > 0);
    if (!keys.includes(key) || entries.length === 0) continue;
    place.append(
      h("h2", null, `${title}, ${unit}`),
      means(entries, key, title, unit),
      h("div", { class: "grid" }, ...entries.map((entry) => picture(entry, title, unit, signal))),
      pairs(entries, key, title, unit),
    );
  }
  if (keys.includes("kinematic_error_mm")) place.append(limits(statistics));
}

const nameOf = ({ quantity }: QuantityEntry): string =>
  ({ calibration: "where fitted", evaluation: "held out" })[quantity] ?? words(quantity);

function means(entries: readonly QuantityEntry[], key: string, title: string, unit: string): HTMLElement {
  const methods = [...new Set(entries.flatMap(({ compared }) => compared.methods))];
  const excluded = [...new Set(entries.flatMap(({ compared }) => Object.entries(compared.excluded).map(([name, why]) => `${name} (${why})`)))];
  return table({
    caption: `${title}, ${unit}: mean ± SD over subjects`,
    name: key,
    columns: [{ title: "quantity" }, { title: "subjects" }, ...methodColumns(methods), { title: "Friedman p" }, { title: "Kendall W" }],
    rows: entries.map((entry): Cell[] => [
      cell(nameOf(entry)),
      cell(String(entry.compared.subjects.length), entry.compared.subjects.length),
      ...methods.map((method) => cell(meanOf(entry, method), entry.mean[method] ?? null)),
      cell(entry.friedman === null ? entry.note || "–" : chance(entry.friedman.p), entry.friedman?.p ?? null),
      cell(number(entry.friedman?.kendall_w, 2), entry.friedman?.kendall_w ?? null),
    ]),
    ...(excluded.length > 0 ? { note: `Not counted: ${excluded.join(", ")}.` } : {}),
  });
}

function meanOf({ mean, sd }: QuantityEntry, method: string): string {
  if (mean[method] === undefined) return "–";
  return sd[method] === undefined ? number(mean[method]) : `${number(mean[method])} ± ${number(sd[method])}`;
}

function picture(entry: QuantityEntry, title: string, unit: string, signal: AbortSignal): HTMLElement {
  const known = styles(entry.compared.methods);
  const groups = entry.compared.methods.map((name) => ({
    name,
    colour: known.get(name)?.colour ?? "",
    mean: entry.mean[name],
    values: Object.entries(entry.values).flatMap(([subject, all]) => (all[name] === undefined ? [] : [{ subject, value: all[name] }])),
  }));
  return figure({
    title: `${title}, ${nameOf(entry)}`,
    name: `${entry.quantity}_${unit}`,
    alt: `A dot for each subject: ${groups.map(({ name, mean }) => `${name} ${number(mean)} ${unit} on average`).join(", ")}.`,
    height: 240,
    drawing: (ink) => drawDots(ink, groups, unit),
    rows: () => [["subject", ...entry.compared.methods], ...Object.entries(entry.values).map(([subject, all]) => [subject, ...entry.compared.methods.map((name) => all[name])])],
  }, signal).element;
}

function pairs(entries: readonly QuantityEntry[], key: string, title: string, unit: string): HTMLElement {
  const rows = entries.flatMap((entry) =>
    (entry.friedman?.pairs ?? []).map((pair) => [
      cell(nameOf(entry)),
      cell(pair.methods.join(" − ")),
      cell(`${signed(pair.difference_mean)} ± ${number(pair.difference_sd)}`, pair.difference_mean),
      cell(chance(pair.p), pair.p),
      cell(pair.significant ? "yes" : "no"),
    ]),
  );
  return table({
    caption: `${title}: differences of pairs of methods, ${unit}, by Tukey's HSD on mean ranks`,
    name: `${key}_pairs`,
    columns: ["quantity", "methods", "difference", "p", "significant"].map((title) => ({ title })),
    rows,
    filter: true,
  });
}

function limits({ opensim_limits: { methods, rms_below_mm, max_below_mm } }: StatisticsDocument): HTMLElement {
  return table({
    caption: `OpenSim's limits: RMS below ${rms_below_mm} mm, at most ${max_below_mm} mm`,
    name: "opensim_limits",
    columns: ["method", "subjects that keep them", "trials that keep them"].map((title) => ({ title })),
    rows: methods.map((one) => [
      cell(one.method),
      cell(`${one.subjects_passed} of ${one.subjects}`, one.subjects_passed),
      cell(`${one.trials_passed} of ${one.trials}`, one.trials_passed),
    ]),
    note: "Necessary, not sufficient.",
  });
}
