/** The axes, unit and rate that were found in a recording, how sure they are, and how to say otherwise. */

import type { ProofDocument, RecordingProof } from "../api/schema.ts";
import { link, type Place } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { problemBox, sentence } from "../ui/problem.ts";
import { number, plural, words } from "../ui/words.ts";

const AXES = ["+x", "-x", "+y", "-y", "+z", "-z"];

export function orientation(recording: RecordingProof, proof: ProofDocument, place: Place): HTMLElement {
  const { axes, format, unit, rate_hz, frames, walked_m, direction, plates, forces_from, repairs, problems } = recording;
  const facts: [string, string][] = [
    ["format", `${format}, ${unit}, ${number(rate_hz, rate_hz % 1 === 0 ? 0 : 2)} Hz, ${plural(frames, "frame")} (${number(frames / rate_hz, 2)} s)`],
    ["axes", `up is ${axes.up}, forward is ${axes.forward} of the laboratory${axes.given ? " (as chosen)" : axes.sure ? "" : " (not sure)"}`],
    ["walking", direction === null ? "nobody walks" : `${number(walked_m, 1)} m, along the arrow`],
    ["forces", forcesInWords(plates, forces_from)],
  ];
  return h(
    "div",
    { class: "orientation" },
    h("dl", { class: "facts" }, ...facts.map(([name, text]) => h("div", null, h("dt", null, name), h("dd", null, text)))),
    h("details", null, h("summary", null, "Why these axes, and what was repaired"),
      h("ul", null, ...[...new Set([...(proof.axes?.why ?? []), ...axes.why, ...repairs.map(({ detail }) => detail)])].map((line) => h("li", null, sentence(line))))),
    ...problems.map((one) => problemBox(one, one.severity)),
    h("div", { class: "actions" }, chooser("up", place), chooser("forward", place)),
  );
}

function forcesInWords(plates: RecordingProof["plates"], from: string | null): string {
  if (plates.length === 0) return "none";
  const described = plates.map(({ name, peak_N, loaded_by }) =>
    [peak_N === null ? words(name) : `${words(name)} up to ${number(peak_N, 0)} N`, ...(loaded_by.length === 0 ? [] : [`(${loaded_by.join("; ")})`])].join(" "));
  return `${described.join(", ")}${from === null ? "" : `, from ${from}`}`;
}

/** Choosing an axis looks at the files again with it; the choice goes on to the methods. */
function chooser(name: "up" | "forward", place: Place): HTMLElement {
  const options = [{ value: "", text: "as found" }, ...AXES.map((value) => ({ value, text: value }))];
  return select(`${name} in the laboratory`, options, place.query.get(name) ?? "", (value) => {
    const query = Object.fromEntries([...place.query, [name, value]].filter(([, given]) => given !== ""));
    location.hash = link(place.parts, query as Record<string, string>);
  });
}
