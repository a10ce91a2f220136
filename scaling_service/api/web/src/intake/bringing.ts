/** Bringing subjects in: the document first, then file after file. */

import type { SubjectDocument } from "../api/documents.ts";
import { Problem } from "../api/problem.ts";
import { putSubject, upload } from "../api/subjects.ts";
import { baseName, type Entry } from "./entries.ts";
import type { Intake } from "./subjectfile.ts";

/** As the service's own rule: letters of any alphabet. */
const NAME = /^[\p{L}\p{N}_][\p{L}\p{N}_ .()+=@,-]{0,199}$/u;

export type Told = (text: string) => void;

/** Put a subject and its files into the service; returns the subject's id. */
export async function bring({ document, files }: Intake, id: string, told: Told): Promise<string> {
  const given = document ?? ({ subject: { id } } as SubjectDocument);
  const { id: subject } = await putSubject(given);
  await uploadAll(subject, files, told);
  return subject;
}

/** @throws Problem before anything is uploaded, where a name cannot be kept. */
export async function uploadAll(subject: string, files: readonly Entry[], told: Told): Promise<void> {
  const odd = files.find(({ path }) => !NAME.test(baseName(path)));
  if (odd !== undefined) {
    throw new Problem({ file: odd.path, problem: "The service cannot keep a file of this name",
      remedy: "Rename it: up to 200 letters, digits, spaces and . ( ) + = @ , - _, beginning with a letter or digit" });
  }
  for (const [place, { path, file }] of files.entries()) {
    told(`Uploading ${place + 1} of ${files.length}: ${baseName(path)}`);
    await upload(subject, baseName(path), file);
  }
  told("");
}

/** An id for a subject without a document: the name of the folder, else of the first file. */
export function proposedId(files: readonly Entry[]): string {
  const path = files[0]?.path ?? "S01";
  const name = path.includes("/") ? (path.split("/")[0] ?? "") : baseName(path).replace(/\.[^.]*$/, "");
  return name.replace(/[^\w .-]/g, "_").replace(/^[^\w]+/, "") || "S01";
}
