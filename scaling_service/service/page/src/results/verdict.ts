/** Which method to use for this person, why, and how far to trust it. */

import { part } from "../api/connection.ts";
import type { ComparisonDocument, VerdictDocument } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawIntervals } from "../charts/intervals.ts";
import { link, toSubject } from "../routes.ts";
import { bullets, callout, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { METHODS } from "../ui/glossary.ts";
import { styles } from "../ui/palette.ts";
import { cell, table, type Cell, type Column, type Tone } from "../ui/table.ts";
import { number, plural } from "../ui/words.ts";
import { baseOf, union, type Finished } from "./result.ts";

const LEVELS = { good: "good", fair: "fair", poor: "poor", unknown: "not known" };

export function verdict(document: ComparisonDocument, found: Finished, place: HTMLElement): void {
  const verdict = document.verdict;
  const { job } = found;
  if (verdict !== null) {
    const seen = h("div");
    const others = ["MB_am", "MB", ...Object.keys(document.methods)].filter((name) => name !== verdict.method && name in document.methods);
    place.append(
      h("div", { class: "outcome" },
        h("div", null, callout(verdict.headline, verdict.tone ?? "plain", bullets(verdict.why)), onwards(found, verdict.strength === "decided"), trust(verdict)),
        h("div", null, seen, bars(document, found))),
    );
    // The words are there at once; the picture comes when it can, and a browser without WebGL does without.
    if (found.scene !== false) void part(() => import("./picture.ts")).then(({ picture }) => picture(job.id, [verdict.method, ...others], found.signal))
      .then((figure) => figure !== null && seen.append(figure))
      .catch(() => seen.append(h("p", { class: "quiet" }, "There is no picture of the models here.")));
  }
  place.append(atAGlance(document), glossary(Object.keys(document.methods)));
  if (document.truth !== null) place.append(truth(document.truth.errors));
  const warnings = [...document.warnings, ...Object.values(document.methods).flatMap((method) => method.warnings)];
  if (warnings.length > 0) place.append(folded(plural(new Set(warnings).size, "note"), bullets([...new Set(warnings)])));
  place.append(recordings(document));
}

export function trust({ method, trust: all }: VerdictDocument): HTMLElement {
  return table({
    caption: `How far to trust ${method}`,
    name: "trust",
    columns: [{ title: "topic" }, { title: "trust" }, { title: "because", words: true }],
    rows: all.map(({ topic, level, text }) => [cell(topic), cell(LEVELS[level], level, level), cell(text)]),
  });
}

function glossary(names: readonly string[]): HTMLElement {
  return folded("What the methods are", h("dl", { class: "facts" }, ...names.map((name) => h("div", null, h("dt", null, name), h("dd", null, METHODS[name] ?? "")))));
}

/** Where one goes from here. */
function onwards(found: Finished, decided: boolean): HTMLElement {
  const { subject } = found.request;
  const to = (part: string): string => link([...baseOf(found), part]);
  return h("nav", { class: "actions", "aria-label": "What to do next" },
    found.scene !== false && h("a", { class: "button", href: to("space") }, "Play the models in space"),
    found.scene !== false && h("a", { class: "button", href: to("angles") }, "Joint angles"),
    h("a", { class: "button", href: to("files") }, "Take the model away"),
    ...(typeof subject === "string" ? [
      h("a", { class: "button", href: toSubject(subject, "run") }, "Find what the model lacks"),
      decided ? null : h("a", { class: "button", href: toSubject(subject) }, "Look at the recordings again")] : []));
}

/** The error of each method with its spread over the recordings' frames: held out where there is such a recording. */
function bars({ methods }: ComparisonDocument, { signal }: Finished): HTMLElement {
  const all = Object.values(methods);
  const heldOut = all.some(({ held_out_mean_mm }) => held_out_mean_mm !== null);
  const known = styles(all.map(({ method }) => method));
  const intervals = all.flatMap(({ method, kinematic_error_mm, held_out_mean_mm, fitted_mean_mm }) => {
    const errors = Object.values(kinematic_error_mm).filter(({ role }) => (role === "evaluation") === heldOut);
    const middle = heldOut ? held_out_mean_mm : fitted_mean_mm;
    if (middle === null || errors.length === 0) return [];
    const sd = Math.sqrt(errors.reduce((sum, one) => sum + one.sd ** 2 + (one.mean - middle) ** 2, 0) / errors.length);
    return [{ name: method, low: middle - sd, middle, high: middle + sd, colour: known.get(method)?.colour ?? "" }];
  });
  return figure({
    title: `Kinematic error ${heldOut ? "held out" : "where fitted"}, mm (mean ± SD over frames)`,
    name: "verdict_errors_mm",
    alt: intervals.map(({ name, middle, high }) => `${name} ${number(middle)} ± ${number(high - middle)} mm`).join("; "),
    height: 66 + 24 * intervals.length,
    drawing: (ink) => drawIntervals(ink, intervals, "mean distance, mm", 70, true),
    rows: () => [["method", "mean_mm", "sd_mm"], ...intervals.map((one) => [one.name, one.middle, one.high - one.middle])],
  }, signal).element;
}

/** A column for each method, in its colour. */
export function methodColumns(methods: readonly string[]): Column[] {
  const known = styles(methods);
  return methods.map((title) => ({ title, colour: known.get(title)?.colour ?? "" }));
}

function atAGlance({ methods }: ComparisonDocument): HTMLElement {
  const all = Object.values(methods);
  const line = (title: string, value: (method: (typeof all)[number]) => number | null, digits: number): Cell[] => [
    cell(title),
    ...all.map((method) => cell(number(value(method), digits), value(method))),
  ];
  return table({
    caption: "Kinematic error and what was fitted",
    name: "glance",
    columns: [{ title: "" }, ...methodColumns(Object.keys(methods))],
    rows: [
      line("error where fitted, mm", (method) => method.fitted_mean_mm, 1),
      line("error held out, mm", (method) => method.held_out_mean_mm, 1),
      line("ratio of held out to fitted", (method) => method.held_out_ratio, 2),
      line("fitted parameters", (method) => method.parameters.length, 0),
      line("of these not determined", (method) => method.parameters.filter((one) => !one.identifiable).length, 0),
      line("of these at their bounds", (method) => method.parameters.filter((one) => one.at_bound).length, 0),
    ],
    note: "A small error proves little: fitted lengths and markers absorb skin movement. Look at what was held out, and at what is not determined.",
  });
}

function truth(all: Record<string, Record<string, number>>): HTMLElement {
  const names = union(Object.values(all));
  const rows = names.map((name) => {
    const best = Math.min(...Object.values(all).map((errors) => errors[name] ?? Infinity));
    const unit = name.slice(name.lastIndexOf("_") + 1);
    return [
      cell(`${name.slice(0, name.lastIndexOf("_")).replaceAll("_", " ")}, ${unit}`),
      ...Object.values(all).map((errors) => {
        const tone: Tone | undefined = errors[name] === best ? "good" : undefined;
        return cell(number(errors[name]), errors[name] ?? null, tone);
      }),
    ];
  });
  return table({
    caption: "This person is virtual: distance from the truth on held-out trials",
    name: "truth",
    columns: [{ title: "" }, ...methodColumns(Object.keys(all))],
    rows,
    note: "The verdict does not know these numbers. The dot marks the nearest to the truth.",
  });
}

function recordings({ markers_used, repairs }: ComparisonDocument): HTMLElement {
  const labels = Object.entries(markers_used).map(([marker, used]) => [cell(marker), cell(used.join(", "))]);
  const alike = new Map<string, { trials: string[]; row: Cell[] }>(); // the same in several recordings is shown once
  for (const [trial, all] of Object.entries(repairs)) {
    for (const { what, where, detail, frames } of all) {
      const row = [cell(what), cell(where.startsWith(`${trial}.`) ? "labels" : where), cell(detail), cell(String(frames), frames)];
      const key = row.map(({ text }) => text).join("|");
      alike.set(key, { trials: [...(alike.get(key)?.trials ?? []), trial], row });
    }
  }
  const notes = [...alike.values()].map(({ trials, row }) => [cell(trials.join(", ")), ...row]);
  return folded(
    "What was done to the recordings",
    table({
      caption: "Repairs and decisions",
      name: "repairs",
      columns: [{ title: "recordings" }, { title: "what", words: true }, { title: "where", words: true }, { title: "detail", words: true }, { title: "frames" }],
      rows: notes,
      filter: true,
    }),
    labels.length > 0 && table({ caption: "Markers and their labels", name: "labels", columns: [{ title: "marker" }, { title: "labels", words: true }], rows: labels, filter: true }),
  );
}
