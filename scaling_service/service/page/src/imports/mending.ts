/** One marker put right where it is seen to be wrong: left out, taken for another, or exchanged with one. */

import type { Correction } from "../api/schema.ts";
import { select } from "../ui/choice.ts";
import { fill, h, newId } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";

export interface Wrong {
  file: string;
  /** As it stands in the file. */
  label: string;
  /** All that it can be taken for or exchanged with. */
  labels: readonly string[];
  /** From when to when the recording lasts, s. */
  span: readonly [number, number];
}

const WAYS = [
  { value: "out", text: "leave it out: a gap, filled as gaps are" },
  { value: "as", text: "it is in truth" },
  { value: "with", text: "exchange it with" },
];

/** A form for one marker.
 *
 * @param now the time that is shown, s.
 * @param title of its button.
 * @param keep called with what is to be corrected.
 */
export function mending(wrong: Wrong, now: () => number, title: string, keep: (correction: Correction) => Promise<void>): HTMLElement {
  const { file, label, labels, span } = wrong;
  const others = labels.filter((one) => one !== label).map((value) => ({ value, text: value }));
  let [way, other] = ["out", others[0]?.value ?? ""];
  const failed = h("div");
  const which = h("span");
  const time = (name: string, value: number): { input: HTMLInputElement; element: HTMLElement } => {
    const id = newId("time");
    const input = h("input", { id, type: "number", step: "0.01", min: span[0].toFixed(2), max: span[1].toFixed(2), value: value.toFixed(2) });
    return { input, element: h("span", { class: "field" }, h("label", { for: id }, `${name}, s`), input,
      h("button", { type: "button", class: "small", "aria-label": `now: ${name}`, onclick: () => void (input.value = now().toFixed(2)) }, "now")) };
  };
  const [from, to] = [time("from", span[0]), time("to", span[1])];
  const choose = (chosen: string): void => {
    way = chosen;
    const list = select("which marker", others, other, (value) => void (other = value));
    list.querySelector("label")?.classList.add("sr");
    fill(which, way !== "out" && list);
  };
  choose(way);
  const correction = (): Correction => ({
    labels: way === "out" ? { [label]: null } : way === "as" ? { [label]: other } : { [label]: other, [other]: label },
    from_s: Number(from.input.value),
    to_s: Number(to.input.value),
  });
  return h("form", { class: "mending", "aria-label": `Put ${label} right`, onsubmit: (event) => {
    event.preventDefault();
    void guarded(failed, () => keep(correction()));
  } },
  h("p", null, h("b", null, `Is ${label} wrong in ${file}?`), " The file itself stays as it is, and this can be undone under Recordings."),
  h("div", { class: "actions" }, select("what to do", others.length > 0 ? WAYS : WAYS.slice(0, 1), way, choose), which, from.element, to.element, h("button", { class: "main" }, title)),
  failed);
}
