/** Bringing subjects in: the document first, then file after file. */

import { Problem } from "../api/problem.ts";
import type { SubjectDocument } from "../api/schema.ts";
import { putSubject, upload } from "../api/subjects.ts";
import { leave } from "../ui/flash.ts";
import { baseName, type Entry } from "./entries.ts";
import { keptName } from "./names.ts";
import type { Intake } from "./subjectfile.ts";

export type Progress = (text: string) => void;

/** Put a subject and its files into the service; returns the subject's id. */
export async function bring({ document, files }: Intake, id: string, report: Progress): Promise<string> {
  const given = document ?? ({ subject: { id } } as SubjectDocument);
  const { id: subject } = await putSubject(given);
  await uploadAll(subject, files, report);
  return subject;
}

/** @throws Problem before anything is uploaded, where two files would have the same name. */
export async function uploadAll(subject: string, files: readonly Entry[], report: Progress): Promise<void> {
  const names = files.map(({ path }) => keptName(path));
  const twice = names.find((name, place) => names.indexOf(name) !== place);
  if (twice !== undefined) {
    throw new Problem({ file: twice, problem: "Two files would have this name, for folders are not kept", remedy: "Rename one, or leave it out" });
  }
  const renamed = files.flatMap(({ path }, k) => (baseName(path).normalize("NFC") === names[k] ? [] : [`${baseName(path)} is kept as ${names[k]}`]));
  for (const [place, { file }] of files.entries()) {
    const name = names[place] ?? file.name;
    report(`Uploading ${place + 1} of ${files.length}: ${name}`);
    await upload(subject, name, file);
  }
  report("");
  if (renamed.length > 0) leave(`Some signs cannot stand in names: ${renamed.join("; ")}.`);
}

/** An id for a subject without a document: the name of the folder, else of the first file. */
export function proposedId(files: readonly Entry[]): string {
  const path = files[0]?.path ?? "S01";
  const name = path.includes("/") ? (path.split("/")[0] ?? "") : baseName(path).replace(/\.[^.]*$/, "");
  return name.normalize("NFC").replace(/[^\p{L}\p{N}_ .-]/gu, "_").replace(/^[ .-]+/, "") || "S01";
}
