/** What shows the result of a job. */

import type { JobDocument, Origin } from "../api/schema.ts";
import type { Place } from "../routes.ts";
import { toJob } from "../routes.ts";
import { tabs } from "../ui/tabs.ts";

export interface Finished {
  job: JobDocument;
  origin: Origin;
  main: HTMLElement;
  place: Place;
  signal: AbortSignal;
}

/** All keys, in the order in which they first appear. */
export function union(all: readonly Record<string, unknown>[]): string[] {
  return [...new Set(all.flatMap((one) => Object.keys(one)))];
}

export type ResultView = (found: Finished) => Promise<void> | void;

/** The parts of a result, one of which is shown; the first unless the address names another. */
export async function parts(
  label: string,
  found: Finished,
  all: readonly { name: string; title: string; show: (place: HTMLElement) => Promise<void> | void }[],
): Promise<void> {
  const chosen = all.find(({ name }) => name === found.place.parts[2]) ?? all[0];
  if (chosen === undefined) return;
  const links = all.map(({ name, title }) => ({ name, title, href: toJob(found.job.id, name) }));
  found.main.append(tabs(label, links, chosen.name));
  await chosen.show(found.main);
}
