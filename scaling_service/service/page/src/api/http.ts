/** Requests to the service. They survive its restarts, its being busy, and a missing key. */

import { pause, recovered } from "./connection.ts";
import { askForKey, authorised, currentKey } from "./key.ts";
import { isAbort, problemOf } from "./problem.ts";

export interface Asked {
  method?: "GET" | "POST" | "PUT" | "DELETE";
  body?: BodyInit;
  headers?: Record<string, string>;
  signal?: AbortSignal | undefined;
}

const BUSY = new Set([429, 503]);
const MOST_WAIT_S = 5;

/** The answer to a request; all requests of this service may be repeated.
 *
 * @throws Problem where the service says no.
 */
export async function send(path: string, asked: Asked = {}): Promise<Response> {
  for (;;) {
    const used = currentKey();
    const answer = await attempt(path, asked);
    if (answer === null) {
      await recovered();
    } else if (answer.status === 401) {
      await askForKey(used);
    } else if (BUSY.has(answer.status)) {
      await pause(1000 * Math.min(Number(answer.headers.get("Retry-After") ?? 1), MOST_WAIT_S));
    } else if (answer.ok) {
      return answer;
    } else {
      throw await problemOf(answer);
    }
    asked.signal?.throwIfAborted();
  }
}

async function attempt(path: string, asked: Asked): Promise<Response | null> {
  try {
    return await fetch(path, { ...plain(asked), headers: authorised(new Headers(asked.headers)) });
  } catch (error) {
    if (isAbort(error)) throw error;
    return null; // no connection
  }
}

function plain({ method, body, signal }: Asked): RequestInit {
  return { method: method ?? "GET", body: body ?? null, signal: signal ?? null };
}

export async function getJson<Document>(path: string, signal?: AbortSignal): Promise<Document> {
  return (await (await send(path, { signal })).json()) as Document;
}

export async function sendJson<Document>(path: string, document: unknown, method: "POST" | "PUT" = "POST"): Promise<Document> {
  const headers = { "Content-Type": "application/json" };
  return (await (await send(path, { method, body: JSON.stringify(document), headers })).json()) as Document;
}
