/** What a view is: it fills the middle of the page until its signal aborts. */

import type { Place } from "../routes.ts";

export interface Context {
  place: Place;
  main: HTMLElement;
  signal: AbortSignal;
}

export type View = (context: Context) => Promise<void> | void;
