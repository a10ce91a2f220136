/** Jobs: ask, look, follow, cancel, fetch. */

import { isOver, jobsOf } from "./events.ts";
import { getJson, send, sendJson } from "./http.ts";
import { Problem } from "./problem.ts";
import type { FileEntry, FileList, JobDocument, JobPage, Origin } from "./schema.ts";

export const ask = (route: string, request: unknown): Promise<JobDocument> => sendJson(`/v1/${route}`, request);

export const getJob = (id: string, signal?: AbortSignal): Promise<JobDocument> => getJson(`/v1/jobs/${id}`, signal);

export const getOrigin = (id: string): Promise<Origin> => getJson(`/v1/jobs/${id}/origin`);

export const getResult = <Result>(id: string, signal?: AbortSignal): Promise<Result> =>
  getJson(`/v1/jobs/${id}/result`, signal);

export const listFiles = async (id: string): Promise<FileEntry[]> =>
  (await getJson<FileList>(`/v1/jobs/${id}/files`)).items;

export const filePath = (id: string, name: string): string =>
  `/v1/jobs/${id}/files/${name.split("/").map(encodeURIComponent).join("/")}`;

export interface Chosen {
  subject?: string;
  kind?: string;
  state?: string;
  cursor?: string;
  limit?: string;
}

export function listJobs(chosen: Chosen = {}, signal?: AbortSignal): Promise<JobPage> {
  return getJson(`/v1/jobs?${new URLSearchParams({ ...chosen })}`, signal);
}

/** Cancels a job that is not over; deletes one that is. */
export async function end(id: string): Promise<void> {
  await send(`/v1/jobs/${id}`, { method: "DELETE" });
}

/** Follow a job until it is over.
 *
 * @throws Problem if it ends without a result.
 */
export async function finished(job: JobDocument, changed: (job: JobDocument) => void, signal: AbortSignal): Promise<JobDocument> {
  let latest = job;
  changed(latest);
  if (!isOver(latest)) {
    for await (const found of jobsOf(latest.id, latest.revision, signal)) {
      latest = found;
      changed(latest);
    }
  }
  if (latest.state === "done") return latest;
  throw new Problem(latest.failure ?? { problem: `The job is ${latest.state}`, remedy: "Ask for it again" });
}

/** Ask for a job and wait for its result. */
export async function resultOf<Result>(
  route: string,
  request: unknown,
  changed: (job: JobDocument) => void,
  signal: AbortSignal,
): Promise<{ job: JobDocument; result: Result }> {
  const job = await finished(await ask(route, request), changed, signal);
  return { job, result: await getResult<Result>(job.id, signal) };
}
