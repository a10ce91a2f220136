/** Whether the service answers. After silence it is asked until it is back; whoever waits then goes on. */

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;

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
