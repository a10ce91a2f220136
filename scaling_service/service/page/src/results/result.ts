/** What shows the result of a job. */

import type { Place } from "../routes.ts";
import { toJob } from "../routes.ts";
import { h } from "../ui/dom.ts";
import { tabs } from "../ui/tabs.ts";

export interface Finished {
  job: { id: string; kind: string };
  /** What was asked for; within a report nothing, for there nothing can be asked for. */
  request: Record<string, unknown>;
  /** What shows how the result is taken away. */
  takeAway: (found: Finished, place: HTMLElement) => Promise<void> | void;
  main: HTMLElement;
  place: Place;
  signal: AbortSignal;
}

/** All keys, in the order in which they first appear. */
export function union(all: readonly Record<string, unknown>[]): string[] {
  return [...new Set(all.flatMap((one) => Object.keys(one)))];
}

export type ResultView = (found: Finished) => Promise<void> | void;

export interface Part {
  name: string;
  title: string;
  show: (place: HTMLElement) => Promise<void> | void;
  /** Whether it is only there to be handled, and not to be read or printed. */
  handled?: boolean;
}

/** All parts below each other, to be read through or printed. */
const EVERYTHING = "everything";

/** The parts of a result, one of which is shown, the first unless the address names another; or all to be read. */
export async function parts(label: string, found: Finished, given: readonly Part[]): Promise<void> {
  const own: Part[] = [...given, { name: "files", title: "Take away", show: (place) => found.takeAway(found, place), handled: true }];
  const read = own.filter(({ handled }) => handled !== true);
  const whole: Part = { name: EVERYTHING, title: "All on one page", show: (place) => through(read, place) };
  const all = read.length > 1 ? [...own, whole] : own;
  const chosen = all.find(({ name }) => name === found.place.parts[2]) ?? all[0];
  if (chosen === undefined) return;
  const links = all.map(({ name, title }) => ({ name, title, href: toJob(found.job.id, name) }));
  found.main.append(tabs(label, links, chosen.name));
  await chosen.show(found.main);
}

async function through(all: readonly Part[], place: HTMLElement): Promise<void> {
  for (const { title, show } of all) {
    const section = h("section", null, h("h2", null, title));
    place.append(section);
    await show(section);
  }
}
