/** Which effects explain it, how large they are, what cannot be told from them, and what else was tried. */

import type { DiscoveryDocument, EffectDocument, PlacedEffect, QuantityDocument } from "../api/schema.ts";
import { barsHeight, drawBars } from "../charts/bars.ts";
import { figure } from "../charts/figure.ts";
import { bullets, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { AFTER, TRIED } from "../ui/palette.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { figures, plural, withUnit, words } from "../ui/words.ts";

const MOST_TRIED = 10;
const NORMAL_95 = 1.96;

export function what(document: DiscoveryDocument, signal: AbortSignal, place: HTMLElement): void {
  if (document.effects.length === 0) place.append(h("p", null, `No effect was named: ${document.reason}.`));
  if (document.effects.length + document.tried.length > 0) place.append(candidates(document, signal));
  document.effects.forEach((effect, k) => place.append(h("h2", null, `${k + 1}. ${placed(effect)}`), ...chapter(effect)));
  if (document.unexplained.length > 0) place.append(unexplained(document));
  if (document.estimates.length > 0) place.append(estimates(document));
  place.append(h("p", { class: "quiet" }, `The search stopped: ${document.reason}.`));
}

function chapter(effect: EffectDocument): HTMLElement[] {
  const alike = effect.confusable_with;
  return [
    h("p", null, `${sentence(effect.name)} ${effect.evidence.summary}`),
    h("p", null, effect.belief == null ? "" : `How sure: ${effect.belief.summary}.`),
    numbers(effect),
    alike.length > 0
      ? h("div", null, effect.would_separate !== null && h("p", null, h("b", null, "To record next: "), `${effect.would_separate}. It would tell this from what looks the same here.`),
          folded(`These recordings do not tell it from ${plural(alike.length, "other")}`, bullets(alike.map(placed))))
      : h("p", { class: "quiet" }, "These recordings tell it from every other effect of the catalogue."),
  ];
}

function numbers(effect: EffectDocument): HTMLElement {
  return table({
    caption: `Numbers of the ${placed(effect)}`,
    name: "effect",
    columns: ["number", "value", "95 % interval", "met", "named from"].map((title) => ({ title })),
    rows: Object.entries(effect.parameters).map(([name, quantity]) => [
      cell(withUnit(name)),
      cell(valueOf(quantity), undefined, doubtful(quantity) ? "fair" : undefined),
      cell(interval(quantity)),
      cell(quantity.usual == null ? "–" : quantity.usual.map((end) => figures(end)).join(" to ")),
      cell(figures(effect.smallest_nameable[name]), effect.smallest_nameable[name] ?? null),
    ]),
    note: "True minus modelled, or measured over true for a factor. Met: in laboratories. Named from: the size that is named nine times in ten.",
  });
}

const valueOf = ({ value }: QuantityDocument): string =>
  Array.isArray(value) ? value.map((one) => one.toFixed(2)).join(", ") : figures(value);

/** Whether a number lies outside of what laboratories meet. */
const doubtful = ({ value, usual }: QuantityDocument): boolean =>
  usual != null && !Array.isArray(value) && (value < usual[0] || value > usual[1]);

function interval({ value, sd }: QuantityDocument): string {
  if (sd === null || Array.isArray(value)) return "–";
  return `${figures(value - NORMAL_95 * sd)} to ${figures(value + NORMAL_95 * sd)}`;
}

function candidates({ effects, tried }: DiscoveryDocument, signal: AbortSignal): HTMLElement {
  const named = effects.map((effect) => ({ name: placed(effect), value: 100 * (effect.evidence.gain_held_out ?? 0), colour: AFTER }));
  const others = tried.map((one) => ({ name: placed(one), value: 100 * (one.gain ?? 0), colour: TRIED }));
  const most = (all: typeof named): typeof named => [...all].sort((a, b) => b.value - a.value);
  const bars = [...most(named), ...most(others).slice(0, MOST_TRIED)];
  return figure({
    title: "Candidates: named (blue), and the best of those that were not",
    name: "candidates",
    alt: `Bars of ${bars.length} candidates; named: ${named.map(({ name, value }) => `${name} ${figures(value)} %`).join(", ") || "none"}.`,
    height: barsHeight(bars.length),
    drawing: (ink) => drawBars(ink, { bars, axis: "share taken off what did not fit it, %", unit: "%" }),
    rows: () => [["candidate", "gain_percent", "named"], ...[...named, ...others].map((one, k) => [one.name, one.value, k < named.length ? 1 : 0])],
    note: "Each is judged when it was tried: later ones on what earlier ones left.",
  }, signal).element;
}

function unexplained({ unexplained: all }: DiscoveryDocument): HTMLElement {
  return table({
    caption: "Beyond what is ordinary, and like no effect that is known",
    name: "unexplained",
    columns: [{ title: "where" }, { title: "described by", words: true }, { title: "left over" }, { title: "ordinary" }],
    rows: all.map((one) => [cell(places(one.where).join(", ") || "the whole recording"), cell(one.law), cell(`${figures(one.rms)} ${one.unit}`, one.rms), cell(figures(one.floor), one.floor)]),
  });
}

/** What recordings say of the model where nothing is named, the numbers that they tell. */
function estimates({ estimates: all }: DiscoveryDocument): HTMLElement {
  const told = all.flatMap((one) => Object.entries(one.parameters).filter(([, quantity]) => quantity.determined).map(([name, quantity]) => ({ one, name, quantity })));
  return folded("What these recordings say of single masses, centres and axes of the model, named or not", table({
    caption: "True minus modelled, were only this unlike the model",
    name: "estimates",
    columns: [{ title: "where" }, { title: "number" }, { title: "value" }, { title: "95 % interval" }],
    rows: told.map(({ one, name, quantity }) => [cell(placed(one)), cell(withUnit(name)), cell(valueOf(quantity)), cell(interval(quantity))]),
    filter: true,
    note: "Deviations hold what is ordinary of all else. Numbers of which recordings tell less than half are left out.",
  }));
}

/** What holds of the recording as a whole has no place. */
const WHOLE = new Set(["world", "markers", "forces"]);

/** Where something is, for people; empty of what concerns the whole recording. */
export const places = (where: readonly string[]): string[] => where.filter((name) => !WHOLE.has(name)).map(words);

/** Names in a row; those with commas of their own are kept apart. */
const listed = (names: readonly string[]): string => names.join(names.some((name) => name.includes(",")) ? "; " : ", ");

/** An effect in a line: what, where, along with what, in which recording. */
function placed({ kind, where, driver, trials, note }: PlacedEffect): string {
  const found = places(where);
  const following = driver.length === 0 ? "" : ` with ${listed(driver.map(words))}`;
  return `${kind.replaceAll("_", " ")}${found.length === 0 ? "" : ` at ${listed(found)}`}${following}${trials === null ? "" : ` in ${trials.join(", ")}`}${note === "" ? "" : ` (${note})`}`;
}
