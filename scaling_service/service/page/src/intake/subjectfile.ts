/** Subject files among what was dropped, as the documents that the service takes. */

import { part } from "../api/connection.ts";
import { Problem } from "../api/problem.ts";
import type { SubjectDocument } from "../api/schema.ts";
import { folderOf, type Entry } from "./entries.ts";
import { keptName } from "./names.ts";

export interface Intake {
  document: SubjectDocument | null;
  /** Where the subject file lies; empty where there is none. */
  path: string;
  files: Entry[];
}

const LARGEST_BYTES = 1_000_000;

/** One intake for each subject file, with the files that it names; without any, one with all files. */
export async function sortedOut(entries: readonly Entry[]): Promise<Intake[]> {
  const found: Intake[] = [];
  for (const entry of entries) {
    const document = await documentOf(entry);
    if (document !== null) found.push({ document: flat(document), path: entry.path, files: named(entry.path, document, entries) });
  }
  if (found.length === 0) return [{ document: null, path: "", files: [...entries] }];
  const [only] = found;
  if (found.length === 1 && only !== undefined) {
    only.files = entries.filter(({ path }) => path !== only.path);
  }
  return found;
}

/** The document in a file, null where it is no subject file.
 *
 * @throws Problem where it is named like one and cannot be read.
 */
async function documentOf({ path, file }: Entry): Promise<SubjectDocument | null> {
  if (!/\.(ya?ml|json)$/i.test(path) || file.size > LARGEST_BYTES) return null;
  const { parse } = await part(() => import("yaml"), { unsaved: true });
  try {
    const found: unknown = parse(await file.text(), { maxAliasCount: 20 });
    return isSubject(found) ? found : null;
  } catch (error) {
    throw new Problem({ file: path, problem: `it is not valid YAML: ${String(error).split("\n")[0]}`, remedy: "Correct it, or leave it out" });
  }
}

function isSubject(found: unknown): found is SubjectDocument {
  return typeof found === "object" && found !== null && "subject" in found && ("trials" in found || "bones" in found);
}

/** The same with plain names: uploaded files lie in no folders. */
function flat(document: SubjectDocument): SubjectDocument {
  const plain = (found: object | null | undefined): Record<string, string> | null | undefined =>
    found && Object.fromEntries(Object.entries(found as Record<string, string>).map(([name, path]) => [keptName(name), name === "units" ? path : keptName(path)]));
  const { trials } = document;
  return withoutUndefined({
    ...document,
    model: document.model && keptName(document.model),
    marker_set: document.marker_set && keptName(document.marker_set),
    scale_setup: document.scale_setup && keptName(document.scale_setup),
    image_markers: document.image_markers && keptName(document.image_markers),
    trials: trials && {
      static: trials.static ? keptName(trials.static) : null,
      calibration: (trials.calibration ?? []).map(keptName),
      evaluation: (trials.evaluation ?? []).map(keptName),
    },
    forces: plain(document.forces),
    bones: plain(document.bones),
  });
}

function withoutUndefined(document: Record<string, unknown>): SubjectDocument {
  const given = Object.entries(document).filter(([, value]) => value !== undefined && value !== "");
  return Object.fromEntries(given) as unknown as SubjectDocument;
}

/** The dropped files that a document names, found from where it lies. */
function named(at: string, document: SubjectDocument, entries: readonly Entry[]): Entry[] {
  const texts = new Set([...textsOf(document)].map((text) => joined(folderOf(at), text)));
  return entries.filter(({ path }) => texts.has(path));
}

function* textsOf(found: unknown): Generator<string> {
  if (typeof found === "string") yield found;
  else if (typeof found === "object" && found !== null) for (const value of Object.values(found)) yield* textsOf(value);
}

export function joined(folder: string, path: string): string {
  const parts: string[] = [];
  for (const part of `${folder}${path}`.split("/")) {
    if (part === "..") parts.pop();
    else if (part !== "." && part !== "") parts.push(part);
  }
  return parts.join("/");
}
