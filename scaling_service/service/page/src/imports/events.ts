/** Heel strikes and toe-offs of a recording: shown, gone to, taken out, and marked at the time that is shown. */

import type { EventProof, GaitEventEntry, RecordingProof } from "../api/schema.ts";
import { h } from "../ui/dom.ts";
import { number } from "../ui/words.ts";

const KINDS: Record<EventProof["kind"], string> = { strike: "heel strike", off: "toe-off" };
const SIDES: Record<EventProof["side"], string> = { r: "right", l: "left" };
const SOURCES: Record<EventProof["source"], string> = { document: "chosen here", file: "in the file", plates: "by the plates" };

/**
 * @param now the time that is shown, s.
 * @param go called with the time of an event that was clicked.
 * @param keep called with all events of the recording once one was changed; null: those that are found.
 */
export function eventList({ name, events }: RecordingProof, now: () => number, go: (time_s: number) => void, keep: (all: GaitEventEntry[] | null) => void): HTMLElement {
  const plain = events.map(({ side, kind, time_s }): GaitEventEntry => ({ side, kind, time_s }));
  const said = ({ side, kind, time_s }: GaitEventEntry): string => `${SIDES[side]} ${KINDS[kind]} at ${number(time_s, 2)} s`;
  const rows = events.map((event, k) => h("li", null,
    h("button", { class: "linked", onclick: () => go(event.time_s) }, said(event)),
    h("span", { class: "quiet" }, ` ${SOURCES[event.source]} `),
    h("button", { class: "small", "aria-label": `Remove: ${said(event)}`, onclick: () => keep(plain.filter((_, place) => place !== k)) }, "Remove")));
  const marks = (["r", "l"] as const).flatMap((side) => (["strike", "off"] as const).map((kind) =>
    h("button", { class: "small", onclick: () => keep([...plain, { side, kind, time_s: Number(now().toFixed(3)) }].sort((a, b) => a.time_s - b.time_s)) },
      `${SIDES[side]} ${KINDS[kind]}`)));
  const chosen = events.some(({ source }) => source === "document");
  const byPlates = events.some(({ source }) => source === "plates");
  return h("section", { class: "events" }, h("h3", null, `Heel strikes and toe-offs in ${name}`),
    h("p", { class: "quiet" }, rows.length === 0 ? "None is in the file, and no plate shows one. Without any, strides are found from the markers of feet and pelvis."
      : "From one heel strike of a foot to its next is a stride, and these come before what markers of the foot say."),
    h("ul", null, ...rows),
    h("div", { class: "actions" }, h("span", { class: "quiet" }, "Mark at the time shown:"), ...marks),
    h("div", { class: "actions" },
      byPlates && h("button", { class: "small", onclick: () => keep(plain) }, "Take these for strides"),
      chosen && h("button", { class: "small", onclick: () => keep(null) }, "As they were found")));
}
