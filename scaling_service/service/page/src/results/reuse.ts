/** A model that a job made follows other recordings: those of its subject, or new ones. */

import { getBlob } from "../api/http.ts";
import { ask, filePath, getResult } from "../api/jobs.ts";
import { Problem } from "../api/problem.ts";
import type { ComparisonDocument, FileEntry } from "../api/schema.ts";
import { getSubject, upload } from "../api/subjects.ts";
import { toJob } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { h, newId } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import type { Finished } from "./result.ts";

const MODEL = /(^|\/|_)model\.json$/;

/** Nothing where the job made no model, or is no single subject's. */
export async function reuse({ job, request: { subject }, signal }: Finished, files: readonly FileEntry[]): Promise<HTMLElement | null> {
  const models = files.map(({ name }) => name).filter((name) => MODEL.test(name));
  const { verdict = null } = models.length > 1 ? await getResult<Partial<ComparisonDocument>>(job.id, signal) : {};
  const advised = models.find((name) => name.startsWith(`${verdict?.method}/`));
  let chosen = advised ?? models[0];
  if (chosen === undefined || typeof subject !== "string") return null;
  const id = newId("recordings");
  const picked: HTMLInputElement = h("input", { id, type: "file", multiple: true, accept: ".c3d,.trc,.sto" });
  const failed = h("div");
  const start = (): void => void guarded(failed, async () => {
    if (chosen === undefined) return;
    const recordings = [...(picked.files ?? [])];
    await refuseReplacing(subject, recordings);
    const model = `${job.id.slice(0, 8)}_${chosen.replaceAll("/", "_")}`;
    await upload(subject, model, await getBlob(filePath(job.id, chosen)));
    for (const file of recordings) await upload(subject, file.name, file);
    const names = recordings.map(({ name }) => name);
    const asked = await ask("motions", { subject, model, angles: true, ...(names.length > 0 ? { recordings: names } : {}) });
    location.hash = toJob(asked.id);
  });
  return h(
    "section",
    { class: "card" },
    h("h2", null, "Use a model again"),
    h("p", { class: "quiet" }, "It follows other recordings of this person; without any chosen, all of the subject's movements."),
    advised !== undefined && h("p", { class: "quiet" }, `${advised} stands first because the comparison says: “${verdict?.headline}”`),
    h("div", { class: "actions" },
      models.length > 1 && select("model", [chosen, ...models.filter((name) => name !== chosen)].map((name) => ({ value: name, text: name })), chosen, (name) => void (chosen = name)),
      h("span", { class: "field" }, h("label", { for: id }, "recordings"), picked),
      h("button", { onclick: start }, "Follow")),
    failed,
  );
}

/** What is uploaded under a name that the subject has would take the place of the subject's own file. */
async function refuseReplacing(subject: string, recordings: readonly File[]): Promise<void> {
  if (recordings.length === 0) return;
  const there = new Set((await getSubject(subject)).files.map(({ name }) => name));
  const twice = recordings.find(({ name }) => there.has(name));
  if (twice !== undefined) {
    throw new Problem({ problem: "the subject has a file of this name already", file: twice.name, remedy: "Rename the recording" });
  }
}
