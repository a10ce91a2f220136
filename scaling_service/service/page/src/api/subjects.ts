/** Subjects: their documents and their files. */

import { getJson, receive, send, sendJson } from "./http.ts";
import type { FileEntry, SubjectDetail, SubjectDocument, SubjectPage, SubjectSummary } from "./schema.ts";

const subjectPath = (id: string): string => `/v1/subjects/${encodeURIComponent(id)}`;

let saving: Promise<unknown> = Promise.resolve();

/** A subject, as what was last saved has made it. */
export async function getSubject(id: string, signal?: AbortSignal): Promise<SubjectDetail> {
  await saving.catch(() => undefined);
  return getJson(subjectPath(id), signal);
}

/** Save a subject, after what was saved before. */
export function putSubject(document: SubjectDocument): Promise<SubjectDetail> {
  const saved = saving.catch(() => undefined).then(() => sendJson<SubjectDetail>("/v1/subjects", document));
  saving = saved;
  return saved;
}

export async function listSubjects(signal?: AbortSignal): Promise<SubjectSummary[]> {
  const found: SubjectSummary[] = [];
  let cursor: string | null = "";
  while (cursor !== null) {
    const page: SubjectPage = await getJson(`/v1/subjects?limit=200&cursor=${cursor}`, signal);
    found.push(...page.items);
    cursor = page.next;
  }
  return found;
}

export async function deleteSubject(id: string): Promise<void> {
  await send(subjectPath(id), { method: "DELETE" });
}

export async function upload(subject: string, name: string, content: Blob): Promise<FileEntry> {
  const path = `${subjectPath(subject)}/files/${encodeURIComponent(name)}`;
  const headers = { "Content-Type": "application/octet-stream" };
  return receive(path, { method: "PUT", body: content, headers }, (answer) => answer.json() as Promise<FileEntry>);
}

export async function removeFile(subject: string, name: string): Promise<void> {
  await send(`${subjectPath(subject)}/files/${encodeURIComponent(name)}`, { method: "DELETE" });
}
