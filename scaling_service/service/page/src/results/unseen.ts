/** The gap before and after, between what noise leaves and what a black box reaches: fitted, and unseen. */

import type { DiscoveryDocument, GapDocument, LevelDocument } from "../api/schema.ts";
import { barsHeight, drawBars, type Bar } from "../charts/bars.ts";
import { figure } from "../charts/figure.ts";
import { h } from "../ui/dom.ts";
import { AFTER, BEFORE, CEILING, FLOOR } from "../ui/palette.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { figures } from "../ui/words.ts";

const QUANTITIES = [
  ["whitened", "all together", "times what is ordinary"],
  ["markers_mm", "markers", "mm"],
  ["force_N", "ground force", "N"],
  ["moment_Nm", "moment", "N m"],
] as const;

export function unseen({ gap, held_out_trials }: DiscoveryDocument, signal: AbortSignal, place: HTMLElement): void {
  const judged = held_out_trials.length > 0 ? `recordings that were not fitted (${held_out_trials.join(", ")})` : "blocks of time that were not fitted";
  place.append(h("p", null, `What counts is the gap on ${judged}: before, after what was named was added, what is ordinary for people (ordinary), and what is left where all that is ordinary takes what it can (left by it).`));
  const drawings = QUANTITIES.flatMap(([key, title, unit]) => {
    const level = gap.held_out[key];
    return level === null ? [] : [drawn(title, unit, level, signal)];
  });
  place.append(h("div", { class: "grid" }, ...drawings), levels(gap), places(gap));
}

function drawn(title: string, unit: string, level: LevelDocument, signal: AbortSignal): HTMLElement {
  const bars: Bar[] = [
    { name: "before", value: level.before, colour: BEFORE },
    { name: "after", value: level.after, colour: AFTER },
    { name: "ordinary", value: level.floor, colour: FLOOR },
    { name: "left by it", value: level.ceiling, colour: CEILING },
  ];
  return figure({
    title: `Held out: ${title}, ${unit}`,
    name: `gap_${title.replaceAll(" ", "_")}`,
    alt: bars.map(({ name, value }) => `${name} ${figures(value)}`).join(", "),
    height: barsHeight(bars.length),
    drawing: (ink) => drawBars(ink, { bars, axis: `RMS, ${unit}`, unit }),
    rows: () => [["level", `rms_${unit}`], ...bars.map(({ name, value }) => [name, value])],
  }, signal).element;
}

function cells(level: LevelDocument): Cell[] {
  const between = level.low === null || level.high === null ? "–" : `${figures(level.low)} to ${figures(level.high)}`;
  return [cell(figures(level.before), level.before), cell(figures(level.after), level.after), cell(between),
    cell(figures(level.floor), level.floor), cell(figures(level.ceiling), level.ceiling)];
}

const COLUMNS = ["before", "after", "95 % of after", "ordinary", "left by it"].map((title) => ({ title }));

function levels(gap: { fit: GapDocument; held_out: GapDocument }): HTMLElement {
  const rows = (["held_out", "fit"] as const).flatMap((role) =>
    QUANTITIES.flatMap(([key, title, unit]) => {
      const level = gap[role][key];
      return level === null ? [] : [[cell(`${role === "fit" ? "fitted" : "held out"}: ${title}, ${unit}`), ...cells(level)]];
    }));
  return table({ caption: "The gap", name: "gap", columns: [{ title: "of" }, ...COLUMNS], rows });
}

function places(gap: { held_out: GapDocument }): HTMLElement {
  const rows = Object.entries(gap.held_out.places).map(([name, level]) => [cell(name), cell(level.unit), ...cells(level)]);
  return table({ caption: "At each place, held out", name: "gap_places", columns: [{ title: "place" }, { title: "unit" }, ...COLUMNS], rows, filter: true });
}
