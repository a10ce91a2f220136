/** What can run on what is there, and one click to give what lacks. */

import type { Need, Readiness } from "../api/schema.ts";
import { h } from "../ui/dom.ts";

export function readinessOf(all: readonly Readiness[], give: (what: Need["give"]) => void): HTMLElement {
  return h("ul", { class: "readiness", "aria-label": "What can run" }, ...all.map((entry) => badge(entry, give)));
}

/** One analysis: ready or not, with what it needs. */
export function badge({ title, ready, needs }: Readiness, give: (what: Need["give"]) => void): HTMLElement {
  const state = ready ? "ready" : `needs ${needs.filter(({ there, required }) => required && !there).map(({ name }) => name).join(", ")}`;
  return h("li", null, h("p", null, h("b", null, title), h("span", { class: `tone ${ready ? "good" : "fair"}` }, state)), needList(needs, give));
}

export function needList(needs: readonly Need[], give: (what: Need["give"]) => void): HTMLElement {
  return h("p", { class: "needs" }, ...needs.map((need) => {
    const { name, there, required, text, give: what } = need;
    const said = `${there ? "✓" : required ? "✕" : "○"} ${name}`;
    const hint = `${there ? "there" : required ? "missing" : "would help"}: ${text}`;
    return there
      ? h("span", { class: "need there", title: hint }, said)
      : h("button", { class: `need small ${required ? "missing" : ""}`, title: hint, "aria-label": `Give: ${name} (${hint})`, onclick: () => give(what) }, said);
  }));
}
