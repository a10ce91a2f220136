/** The API key: kept for this tab only, and asked for where the service wants one. */

import { tab } from "../ui/memory.ts";

const PLACE = "scaling-service key";

type Asker = (refused: boolean) => Promise<string>;

let asker: Asker | null = null;
let asking: Promise<string> | null = null;

/** Set who asks the person for a key. */
export function askWith(chosen: Asker): void {
  asker = chosen;
}

export function currentKey(): string | null {
  return tab.getItem(PLACE);
}

export function forgetKey(): void {
  tab.removeItem(PLACE);
}

export function authorised(headers: Headers): Headers {
  const key = currentKey();
  if (key !== null) headers.set("Authorization", `Bearer ${key}`);
  return headers;
}

/** Ask for a key, once for all requests that wait for it. `used` is the key that was refused. */
export async function askForKey(used: string | null): Promise<void> {
  if (currentKey() !== used) return; // another request brought a new one meanwhile
  if (asker === null) throw new Error("nobody asks for keys");
  asking ??= asker(used !== null).finally(() => {
    asking = null;
  });
  tab.setItem(PLACE, await asking);
}
