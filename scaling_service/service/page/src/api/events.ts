/** A job's progress as server-sent events, read with fetch, for EventSource cannot carry a key. */

import { pause, recovered } from "./connection.ts";
import { getJson, send } from "./http.ts";
import { isAbort, Problem } from "./problem.ts";
import type { JobDocument } from "./schema.ts";

/** Browsers open six connections to a server, for all tabs together; other requests need some of them. */
const MOST_STREAMS = 2;
const AGAIN_MS = 300;
const LOOK_MS = 1500;

let streams = 0;

/** Whether nothing more happens to a job by itself. */
export function isOver(job: JobDocument): boolean {
  return job.state === "done" || job.state === "failed" || job.state === "cancelled";
}

/** The job each time that it changes, until it is over.
 *
 * A stream that breaks is opened again. Where many jobs are followed at once, those without a stream are
 * looked at every now and then until one is free.
 */
export async function* jobsOf(id: string, known: number, signal: AbortSignal): AsyncGenerator<JobDocument> {
  let seen = known;
  for (;;) {
    for await (const job of streams < MOST_STREAMS ? streamed(id, seen, signal) : looked(id, seen, signal)) {
      seen = job.revision;
      yield job;
      if (isOver(job)) return;
    }
    signal.throwIfAborted();
    await pause(AGAIN_MS);
  }
}

async function* looked(id: string, seen: number, signal: AbortSignal): AsyncGenerator<JobDocument> {
  await pause(LOOK_MS);
  signal.throwIfAborted();
  const job = await getJson<JobDocument>(`/v1/jobs/${id}`, signal);
  if (job.revision > seen) yield job;
}

async function* streamed(id: string, seen: number, signal: AbortSignal): AsyncGenerator<JobDocument> {
  streams += 1;
  try {
    const answer = await send(`/v1/jobs/${id}/events`, { headers: { "Last-Event-ID": String(seen) }, signal });
    if (answer.status === 204 || answer.body === null) {
      yield await getJson<JobDocument>(`/v1/jobs/${id}`, signal);
      return;
    }
    for await (const event of eventsOf(answer.body)) {
      if (event.name === "gone") throw new Problem({ problem: "The job was deleted" }, 404);
      yield JSON.parse(event.data) as JobDocument;
    }
  } catch (error) {
    if (isAbort(error) || error instanceof Problem) throw error;
    await recovered();
  } finally {
    streams -= 1;
  }
}

interface Event {
  name: string;
  data: string;
}

/** The events of a stream (WHATWG HTML, section 9.2), without comments. */
async function* eventsOf(body: ReadableStream<Uint8Array>): AsyncGenerator<Event> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let waiting = "";
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      const blocks = (waiting + value).split("\n\n");
      waiting = blocks.pop() ?? "";
      for (const block of blocks) {
        const event = parsed(block);
        if (event.data !== "") yield event;
      }
    }
  } finally {
    await reader.cancel().catch(() => undefined);
  }
}

function parsed(block: string): Event {
  const event = { name: "message", data: "" };
  for (const line of block.split("\n")) {
    const [field, ...rest] = line.split(":");
    const value = rest.join(":").replace(/^ /, "");
    if (field === "event") event.name = value;
    if (field === "data") event.data += value;
  }
  return event;
}
