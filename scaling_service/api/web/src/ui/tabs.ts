/** Tabs whose choice stands in the address. */

import { h } from "./dom.ts";

export interface Tab {
  name: string;
  title: string;
  href: string;
}

/** Links to the parts of a place; the present one is marked. */
export function tabs(label: string, all: readonly Tab[], present: string): HTMLElement {
  return h(
    "nav",
    { class: "tabs", "aria-label": label },
    ...all.map((tab) => h("a", { href: tab.href, "aria-current": tab.name === present ? "page" : null }, tab.title)),
  );
}
