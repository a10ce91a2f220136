/** Subjects: their documents and their files. */

import { getJson, send, sendJson } from "./http.ts";
import type { FileEntry, SubjectDetail, SubjectDocument, SubjectPage, SubjectSummary } from "./schema.ts";

const subjectPath = (id: string): string => `/v1/subjects/${encodeURIComponent(id)}`;

export const getSubject = (id: string, signal?: AbortSignal): Promise<SubjectDetail> =>
  getJson(subjectPath(id), signal);

export const putSubject = (document: SubjectDocument): Promise<SubjectDetail> =>
  sendJson("/v1/subjects", document);

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
  return (await (await send(path, { method: "PUT", body: content, headers })).json()) as FileEntry;
}

export async function removeFile(subject: string, name: string): Promise<void> {
  await send(`${subjectPath(subject)}/files/${encodeURIComponent(name)}`, { method: "DELETE" });
}
