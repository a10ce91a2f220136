/** Joint angles over the gait cycle, mean over subjects, and where methods differ. */

import type { CurveEntry, CurveTestEntry } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawLines, type Curve } from "../charts/lines.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { cell, table } from "../ui/table.ts";
import { chance, plural, withChance, words } from "../ui/words.ts";

export function cohortAngles(entries: readonly CurveEntry[], signal: AbortSignal, place: HTMLElement): void {
  if (entries.length === 0) {
    place.append(h("p", null, "No gait cycles were found in these recordings."));
    return;
  }
  place.append(
    h("p", { class: "quiet" }, "Mean ± SD over subjects. Grey: where the methods differ by an analysis of variance along the curve, by permutation."),
    h("div", { class: "grid" }, ...entries.map((entry) => picture(entry, signal))),
    pairs(entries),
  );
}

function picture(entry: CurveEntry, signal: AbortSignal): HTMLElement {
  const known = styles(entry.compared.methods);
  const x = Array.from({ length: 101 }, (_, k) => k);
  const curves = entry.compared.methods.flatMap((name): Curve[] => {
    const [style, y] = [known.get(name), entry.mean_deg[name]];
    return style === undefined || y === undefined ? [] : [{ name, style, y, half: entry.sd_deg[name] }];
  });
  const clusters = entry.anova?.clusters.map((one) => [one.start_percent, one.end_percent] as const) ?? [];
  return figure({
    title: `${words(entry.coordinate)} (${decided(entry.anova)})`,
    name: `cohort_${entry.coordinate}_deg`,
    alt: `${words(entry.coordinate)} over the gait cycle, mean over ${plural(entry.compared.subjects.length, "subject")}, by ${entry.compared.methods.join(", ")}.`,
    zoom: true,
    height: 230,
    drawing: (ink) => drawLines(ink, { x, curves, unit: "deg", marked: clusters, xAxis: { name: "gait cycle, %", range: [0, 100] }, yAxis: { name: "deg" } }),
    rows: () => [["percent", ...curves.flatMap((one) => [`${one.name}_mean_deg`, `${one.name}_sd_deg`])],
      ...x.map((percent) => [percent, ...curves.flatMap((one) => [one.y[percent], one.half?.[percent]])])],
    ...(entry.note === "" ? {} : { note: entry.note }),
  }, signal).element;
}

const decided = (test: CurveTestEntry | null): string =>
  test === null ? "not tested" : test.can_decide ? withChance(test.p) : "too few subjects to test";

function pairs(entries: readonly CurveEntry[]): HTMLElement {
  const rows = entries.flatMap((entry) =>
    entry.pairs.map(({ methods, test }) => [
      cell(words(entry.coordinate)),
      cell(methods.join(" − ")),
      test.can_decide ? cell(chance(test.p), test.p) : cell("too few subjects", null),
      cell(test.clusters.map((one) => `${one.start_percent} to ${one.end_percent} %`).join(", ") || "–"),
    ]),
  );
  return table({
    caption: "Pairs of methods along the curve",
    name: "cohort_angle_pairs",
    columns: [{ title: "angle" }, { title: "methods" }, { title: "p" }, { title: "differ", words: true }],
    rows,
    filter: true,
  });
}
