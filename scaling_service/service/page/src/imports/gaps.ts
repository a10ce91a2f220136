/** When each marker was seen: a row for each label, open where it was lost. */

import type { LabelEntry, RecordingProof } from "../api/schema.ts";
import { h, svg } from "../ui/dom.ts";
import { csv, saveText } from "../ui/save.ts";
import { number, percent } from "../ui/words.ts";

const WIDTH = 1000;
const ROW = 12;

/** @param go called with the frame and the label that were clicked. */
export function gapTimeline(recording: RecordingProof, go: (frame: number, label: string) => void): HTMLElement {
  const ordered = [...recording.labels].sort((a, b) => a.seen - b.seen);
  const open = ordered.filter(({ gaps }) => gaps.length > 0);
  return h(
    "section",
    { class: "gaps" },
    h(
      "div",
      { class: "bar" },
      h("h3", null, `Gaps in ${recording.name}`),
      h("span", { class: "push" }),
      h("button", { class: "small", "aria-label": `Save as SVG: gaps in ${recording.name}`, onclick: () => saveText(`gaps_${recording.name}.svg`, drawing(recording), "image/svg+xml") }, "SVG"),
      h("button", { class: "small", "aria-label": `Save as CSV: gaps in ${recording.name}`, onclick: () => saveText(`gaps_${recording.name}.csv`, textOf(recording)) }, "CSV"),
    ),
    open.length === 0
      ? h("p", null, `All ${ordered.length} markers were seen all the time.`)
      : h("p", { class: "quiet" }, `${open.length} of ${ordered.length} labels have gaps; the longest is ${number(Math.max(...open.map((one) => one.longest_gap_s)), 2)} s. A click shows the moment.`),
    h("div", { class: "timeline" }, ...ordered.map((label) => row(label, recording, go))),
  );
}

function row(entry: LabelEntry, recording: RecordingProof, go: (frame: number, label: string) => void): HTMLElement {
  const { frames, rate_hz } = recording;
  const at = (frame: number): number => (WIDTH * frame) / frames;
  const bar = svg(
    "svg",
    { viewBox: `0 0 ${WIDTH} ${ROW}`, preserveAspectRatio: "none", role: "img", "aria-label": spoken(entry) },
    svg("rect", { class: "seen", x: 0, y: 0, width: WIDTH, height: ROW }),
    ...entry.gaps.map(([first, last]) =>
      svg("rect", { class: "gap", x: at(first), y: 0, width: Math.max(at(last + 1) - at(first), WIDTH / 500), height: ROW })),
  );
  bar.addEventListener("click", ({ offsetX }) => go(Math.floor((offsetX / bar.clientWidth) * frames), entry.label));
  const [first] = entry.gaps;
  const hint = entry.gaps.slice(0, 12).map(([from, to]) => `${number(from / rate_hz, 2)}–${number((to + 1) / rate_hz, 2)} s`).join(", ");
  return h(
    "div",
    { class: "row", title: hint === "" ? null : hint },
    h("button", { class: "linked", onclick: () => go(first?.[0] ?? 0, entry.label) }, entry.label),
    h("span", { class: "quiet" }, percent(entry.seen)),
    h("span", { class: "track" }, bar),
  );
}

const spoken = ({ label, seen, gaps, longest_gap_s }: LabelEntry): string =>
  `${label} was seen in ${percent(seen)} of the frames; ${gaps.length} gaps, the longest ${number(longest_gap_s, 2)} s`;

const [NAMES, HIGH] = [140, 14];

/** The same as a drawing of its own. */
function drawing({ name, labels, frames, rate_hz }: RecordingProof): string {
  const rows = labels.map((entry, k) => {
    const y = HIGH * k;
    const at = (frame: number): number => NAMES + (WIDTH * frame) / frames;
    return svg("g", {},
      svg("text", { x: NAMES - 8, y: y + 11, "text-anchor": "end" }, entry.label),
      svg("rect", { x: NAMES, y: y + 2, width: WIDTH, height: HIGH - 4, fill: "#009e73" }),
      ...entry.gaps.map(([first, last]) =>
        svg("rect", { x: at(first), y: y + 2, width: at(last + 1) - at(first), height: HIGH - 4, fill: "#d55e00" })));
  });
  const high = HIGH * (labels.length + 1);
  const scale = svg("text", { x: NAMES, y: high - 3 }, `${name}: 0 to ${number(frames / rate_hz, 2)} s; orange where a marker was not seen`);
  const all = svg("svg", { viewBox: `0 0 ${NAMES + WIDTH + 8} ${high}`, "font-family": "sans-serif", "font-size": 11 }, ...rows, scale);
  return new XMLSerializer().serializeToString(all);
}

function textOf({ labels, rate_hz, start_s }: RecordingProof): string {
  const rows = labels.flatMap(({ label, gaps }) =>
    gaps.map(([first, last]) => [label, first, last, start_s + first / rate_hz, start_s + last / rate_hz]));
  return csv([["label", "first_frame", "last_frame", "from_s", "to_s"], ...rows]);
}
