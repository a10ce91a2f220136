/** Whether the service answers. After silence it is asked until it is back; whoever waits then goes on. */

import { tab } from "../ui/memory.ts";
import { Problem } from "./problem.ts";

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;
const BEGUN_AGAIN = "begun again for ";

type Listener = (lost: boolean) => void;

const listeners = new Set<Listener>();
let recovering: Promise<void> | null = null;

export function onConnection(listener: Listener): void {
  listeners.add(listener);
}

/** Resolves when the service is ready again. */
export function recovered(): Promise<void> {
  recovering ??= untilReady().finally(() => {
    recovering = null;
    tell(false);
  });
  return recovering;
}

/** A part of the page, loaded when it is first needed: once more when the service is back, if it was away.
 *
 * Browsers may remember that a part failed for as long as the page lives; the page then loads itself again, where its
 * address says it was, unless it holds what is not saved yet.
 *
 * @throws Problem where that helped nothing, the service being another version by then, or is left to the user.
 */
export async function part<Module>(load: () => Promise<Module>, { unsaved = false } = {}): Promise<Module> {
  const begunAgain = BEGUN_AGAIN + String(load);
  const once = () => load().then((module) => (tab.removeItem(begunAgain), module));
  try {
    return await once();
  } catch (error) {
    if (!(error instanceof TypeError)) throw error;
  }
  await recovered();
  return once().catch(() => {
    if (unsaved || tab.getItem(begunAgain) !== null) {
      throw new Problem({ problem: "A part of the page could not be loaded", remedy: "Load the page again" });
    }
    tab.setItem(begunAgain, "");
    location.reload();
    return new Promise<Module>(() => undefined); // never: the page that waits for it is gone
  });
}

async function untilReady(): Promise<void> {
  tell(true);
  for (let wait = FIRST_WAIT_MS; ; wait = Math.min(1.5 * wait, LONGEST_WAIT_MS)) {
    const answer = await fetch("/ready", { cache: "no-store" }).catch(() => null);
    if (answer?.ok) return;
    await pause(wait);
  }
}

export function pause(milliseconds: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

function tell(lost: boolean): void {
  for (const listener of listeners) listener(lost);
}
