/** Tabs whose choice stands in the address. */

import { h } from "./dom.ts";

export interface Tab {
  name: string;
  title: string;
  href: string;
}

/** Links to the parts of a place; the present one is marked. */
export function tabs(label: string, all: readonly Tab[], present: string): HTMLElement {
  const links = all.map((tab) => h("a", { href: tab.href, "aria-current": tab.name === present ? "page" : null }, tab.title));
  const element = h("nav", { class: "tabs", "aria-label": label }, ...links);
  // On a narrow page the present one may be beside what is seen.
  requestAnimationFrame(() => element.querySelector("[aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" }));
  return element;
}
