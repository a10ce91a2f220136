/** Where model and recordings disagree, against what is ordinary for people. */

import type { DisagreementDocument, DiscoveryDocument } from "../api/schema.ts";
import { barsHeight, drawBars } from "../charts/bars.ts";
import { figure } from "../charts/figure.ts";
import { h } from "../ui/dom.ts";
import { BEFORE } from "../ui/palette.ts";
import { cell, table } from "../ui/table.ts";
import { chance, figures, percent, words } from "../ui/words.ts";

const OBSERVABLES = [
  ["marker", "Markers", "mm"],
  ["force", "Ground force", "N"],
  ["moment", "Moment", "N m"],
] as const;

export function where({ disagreements }: DiscoveryDocument, signal: AbortSignal, place: HTMLElement): void {
  const [most] = [...disagreements].sort((a, b) => (b.share ?? 0) - (a.share ?? 0));
  if (most !== undefined) {
    place.append(h("p", null, h("b", null, `Model and recordings disagree most at ${named(most)}: ${figures(most.rms)} ${most.unit}, where ${figures(most.floor)} ${most.unit} are ordinary.`)));
  }
  place.append(h("p", null,
    "The model follows every recording as closely as it can. What is left over is compared with what is ordinary for people as lively as this person: skin that slides, markers beside their landmarks, joints that differ from any model's. Places whose bar ends below the mark are ordinary."));
  for (const [observable, title, unit] of OBSERVABLES) {
    const chosen = disagreements.filter((one) => one.observable === observable);
    if (chosen.length > 0) place.append(ranked(chosen, title, unit, signal));
  }
  place.append(all(disagreements));
}

/** Markers are called as they are; what forces are of has a name of the program's. */
const named = ({ where: name, observable }: DisagreementDocument): string => (observable === "marker" ? name : (COMPONENTS[name] ?? words(name)));

const COMPONENTS: Record<string, string> = {
  fx: "force forward", fy: "force up", fz: "force to the right", mx: "moment about forward", my: "moment about up", mz: "moment about right",
};

function ranked(places: readonly DisagreementDocument[], title: string, unit: string, signal: AbortSignal): HTMLElement {
  const order = [...places].sort((a, b) => b.rms - a.rms);
  const bars = order.map((one) => ({ name: named(one), value: one.rms, mark: one.floor, colour: BEFORE }));
  return figure({
    title: `${title}: what is left over, and what is ordinary (marks)`,
    name: `disagreements_${unit.replace(" ", "")}`,
    alt: `Bars of ${bars.length} places, the largest first: ${order.slice(0, 3).map((one) => `${one.where} ${figures(one.rms)}`).join(", ")} ${unit}.`,
    height: barsHeight(bars.length),
    drawing: (ink) => drawBars(ink, { bars, axis: `RMS of what is left over, ${unit}`, unit, marks: "ordinary" }),
    rows: () => [["place", `rms_${unit}`, `floor_${unit}`], ...order.map((one) => [one.where, one.rms, one.floor])],
  }, signal).element;
}

function all(places: readonly DisagreementDocument[]): HTMLElement {
  return table({
    caption: "Where, when, and along with what",
    name: "disagreements",
    columns: [{ title: "place" }, { title: "left over" }, { title: "ordinary" }, { title: "share" }, { title: "by chance" },
      { title: "most", words: true }, { title: "follows", words: true }],
    rows: places.map((one) => [
      cell(named(one)),
      cell(`${figures(one.rms)} ${one.unit}`, one.rms),
      cell(`${figures(one.floor)} ${one.unit}`, one.floor),
      cell(percent(one.share), one.share),
      cell(chance(one.p), one.p),
      cell(one.when || "–"),
      cell(one.along || "–"),
    ]),
    filter: true,
    note: "Share: of all that stands above the ordinary. By chance: p of so much where it is ordinary; what lasts, as skin does, counts once.",
  });
}
