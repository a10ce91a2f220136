/** Requests to the service. They survive its restarts, its being busy, and a missing key. */

import { pause, recovered } from "./connection.ts";
import { askForKey, authorised, currentKey } from "./key.ts";
import { problemOf } from "./problem.ts";

export interface Asked {
  method?: "GET" | "POST" | "PUT" | "DELETE";
  body?: BodyInit;
  headers?: Record<string, string>;
  signal?: AbortSignal | undefined;
}

/** Where answers come from. */
type Reach = (path: string, asked: RequestInit) => Promise<Response>;

let reach: Reach = (path, asked) => fetch(path, asked);

/** Set who answers in place of the service: a report holds all that its views ask for. */
export function answerWith(chosen: Reach): void {
  reach = chosen;
}

const BUSY = new Set([429, 503]);
const MOST_WAIT_S = 5;

/** What is read of the answer to a request. All requests of this service may be repeated, and are where the
 * connection breaks, be it before the answer or within it.
 *
 * @throws Problem where the service says no.
 */
export async function receive<Read>(path: string, asked: Asked, read: (answer: Response) => Promise<Read>): Promise<Read> {
  for (;;) {
    const used = currentKey();
    const answer = await connected(reach(path, { ...plain(asked), headers: authorised(new Headers(asked.headers)) }));
    if (answer === null) {
      await recovered();
    } else if (answer.status === 401) {
      await askForKey(used);
    } else if (BUSY.has(answer.status)) {
      await pause(1000 * Math.min(Number(answer.headers.get("Retry-After") ?? 1), MOST_WAIT_S));
    } else if (answer.ok) {
      const found = await connected(read(answer).then((value) => ({ value })));
      if (found !== null) return found.value;
      await recovered();
    } else {
      throw await problemOf(answer);
    }
    asked.signal?.throwIfAborted();
  }
}

/** Null where the connection is lost, for which `fetch` and the readers of its answers have a `TypeError`. */
function connected<Value>(work: Promise<Value>): Promise<Value | null> {
  return work.catch((error: unknown) => {
    if (error instanceof TypeError) return null;
    throw error;
  });
}

/** The answer itself, for who reads it bit by bit. */
export const send = (path: string, asked: Asked = {}): Promise<Response> => receive(path, asked, async (answer) => answer);

export const getBytes = (path: string, asked: Asked = {}): Promise<ArrayBuffer> => receive(path, asked, (answer) => answer.arrayBuffer());

export const getBlob = (path: string): Promise<Blob> => receive(path, {}, (answer) => answer.blob());

function plain({ method, body, signal }: Asked): RequestInit {
  return { method: method ?? "GET", body: body ?? null, signal: signal ?? null };
}

export async function getJson<Document>(path: string, signal?: AbortSignal): Promise<Document> {
  return receive(path, { signal }, (answer) => answer.json() as Promise<Document>);
}

export async function sendJson<Document>(path: string, document: unknown, method: "POST" | "PUT" = "POST"): Promise<Document> {
  const headers = { "Content-Type": "application/json" };
  return receive(path, { method, body: JSON.stringify(document), headers }, (answer) => answer.json() as Promise<Document>);
}
