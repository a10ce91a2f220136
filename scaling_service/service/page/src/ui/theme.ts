/** Light or dark: as the system has it, unless chosen here. */

import { browser } from "./memory.ts";

export type Theme = "light" | "dark";

const PLACE = "scaling-service theme";
const system = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set<(theme: Theme) => void>();

/** Paper is light. */
let printing = false;

export function theme(): Theme {
  if (printing) return "light";
  const chosen = browser.getItem(PLACE);
  if (chosen === "light" || chosen === "dark") return chosen;
  return system.matches ? "dark" : "light";
}

export function choose(chosen: Theme): void {
  browser.setItem(PLACE, chosen);
  apply();
}

/** Call a listener when the theme changes, until the signal aborts. */
export function onTheme(listener: (theme: Theme) => void, signal: AbortSignal): void {
  listeners.add(listener);
  signal.addEventListener("abort", () => listeners.delete(listener));
}

export function apply(): void {
  document.documentElement.dataset.theme = theme();
  for (const listener of listeners) listener(theme());
}

function print(begins: boolean): void {
  printing = begins;
  apply();
}

system.addEventListener("change", apply);
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
