/** Which method to use for this person, why, and how far to trust it. */

import type { ComparisonDocument } from "../api/schema.ts";
import { toJob } from "../routes.ts";
import { bullets, callout, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { cell, table, type Cell, type Column, type Tone } from "../ui/table.ts";
import { number, plural } from "../ui/words.ts";
import { union } from "./result.ts";
import type { Finished } from "./result.ts";

const TONES = { decided: "good", leaning: "fair", undecided: "unknown" } as const;
const LEVELS = { good: "good", fair: "fair", poor: "poor", unknown: "not known" };

export function verdict(document: ComparisonDocument, { job }: Finished, place: HTMLElement): void {
  const told = document.verdict;
  if (told !== null) {
    place.append(
      callout(told.headline, TONES[told.strength], bullets(told.why)),
      table({
        caption: `How far to trust ${told.method}`,
        name: "trust",
        columns: [{ title: "topic" }, { title: "trust" }, { title: "because", words: true }],
        rows: told.trust.map(({ topic, level, text }) => [cell(topic), cell(LEVELS[level], level, level), cell(text)]),
      }),
    );
  }
  place.append(atAGlance(document), h("p", null, h("a", { href: toJob(job.id, "space") }, "See the models in space")));
  if (document.truth !== null) place.append(truth(document.truth.errors));
  const warnings = [...document.warnings, ...Object.values(document.methods).flatMap((method) => method.warnings)];
  if (warnings.length > 0) place.append(folded(plural(new Set(warnings).size, "note"), bullets([...new Set(warnings)])));
  place.append(recordings(document));
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
      line("held out over fitted", (method) => method.held_out_ratio, 2),
      line("fitted numbers", (method) => method.parameters.length, 0),
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
  const notes = Object.entries(repairs).flatMap(([trial, all]) =>
    all.map((one) => [cell(trial), cell(one.what), cell(one.where), cell(one.detail), cell(String(one.frames), one.frames)]),
  );
  return folded(
    "What was done to the recordings",
    table({
      caption: "Repairs and decisions",
      name: "repairs",
      columns: [{ title: "recording" }, { title: "what", words: true }, { title: "where", words: true }, { title: "detail", words: true }, { title: "frames" }],
      rows: notes,
      filter: true,
    }),
    table({ caption: "Markers and their labels", name: "labels", columns: [{ title: "marker" }, { title: "labels", words: true }], rows: labels, filter: true }),
  );
}
