/** A notice that the next view shows, once. */

import { h } from "./dom.ts";

let waiting: string[] = [];

export function leave(notice: string): void {
  waiting.push(notice);
}

/** What is waiting, as an element; null where nothing is. */
export function notices(): HTMLElement | null {
  const found = waiting;
  waiting = [];
  if (found.length === 0) return null;
  return h("div", { class: "problem warning", role: "status" }, ...found.map((text) => h("p", null, text)));
}
