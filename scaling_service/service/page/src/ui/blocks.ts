/** Blocks of text that results share. */

import { h } from "./dom.ts";
import { explained } from "./glossary.ts";
import type { Tone } from "./table.ts";

export const bullets = (lines: readonly (string | Node)[]): HTMLElement => h("ul", null, ...lines.map((line) => h("li", null, ...(typeof line === "string" ? explained(line) : [line]))));

export function callout(headline: string, tone: Tone | "plain", ...content: (HTMLElement | false)[]): HTMLElement {
  return h("div", { class: `callout ${tone}` }, h("p", { class: "headline" }, ...explained(headline)), ...content);
}

export function folded(title: string, ...content: (HTMLElement | false)[]): HTMLElement {
  return h("details", null, h("summary", null, title), ...content);
}
