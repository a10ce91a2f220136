/** Import: proof of a subject's files before anything runs. */

import { filePath, resultOf } from "../api/jobs.ts";
import type { MarkerMapDocument, ProofDocument, SubjectDetail, SubjectDocument, Vocabulary } from "../api/schema.ts";
import { getSubject, putSubject } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { Draft } from "../imports/draft.ts";
import { facts } from "../imports/facts.ts";
import { fileTable } from "../imports/files.ts";
import { laboratoryMap, MarkerMap } from "../imports/markermap.ts";
import { orientation } from "../imports/orientation.ts";
import { personForm } from "../imports/person.ts";
import { Preview } from "../imports/preview.ts";
import { again, link } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { guarded, problemBox } from "../ui/problem.ts";
import { plural } from "../ui/words.ts";
import { working } from "../ui/working.ts";
import { dropZone } from "./drop.ts";
import { subjectHead } from "./subjecthead.ts";
import type { Context, View } from "./view.ts";

export const importing: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  const [subject, known, laboratory] = await Promise.all([getSubject(id, signal), vocabulary(), laboratoryMap()]);
  main.append(subjectHead(id, "import"));
  if (subject.files.length > 0) await checked({ main, place, signal }, subject, known, laboratory);
  main.append(h("h2", null, "More files"), dropZone(id));
};

async function checked(
  { main, place, signal }: Context,
  subject: SubjectDetail,
  known: Vocabulary,
  laboratory: MarkerMapDocument,
): Promise<void> {
  const progress = working("Looking at the files");
  const failed = h("div");
  const content = h("div");
  main.append(failed, progress.element, content);
  const axes = Object.fromEntries(["up", "forward"].flatMap((name) => (place.query.has(name) ? [[name, place.query.get(name)]] : [])));
  await guarded(failed, async () => {
    const request = { subject: subject.id, labels: laboratory.labels, ...(Object.keys(axes).length > 0 ? { settings: axes } : {}) };
    const { job, result } = await resultOf<ProofDocument>("proofs", request, progress.show, signal);
    if (!signal.aborted) await shown({ main: content, place, signal }, subject, result, job.id, known, laboratory);
  });
}

async function shown(
  { main, place, signal }: Context,
  subject: SubjectDetail,
  proof: ProofDocument,
  job: string,
  known: Vocabulary,
  laboratory: MarkerMapDocument,
): Promise<void> {
  const complete = subject.document.model !== undefined && subject.document.trials !== undefined;
  const given = structuredClone((complete ? subject.document : proof.proposal) ?? subject.document) as unknown as SubjectDocument;
  const saving = h("div", { class: "saving" });
  const draft = new Draft(given, () => tell());
  const next = link(["subjects", subject.id, "run"], Object.fromEntries(place.query));
  const markers = new MarkerMap(proof, draft, laboratory);

  function tell(): void {
    const open = draft.changed || !complete;
    fill(saving, ...actions(draft, open, next));
  }

  tell();
  const errors = proof.problems.filter(({ severity }) => severity === "error");
  main.append(
    h("p", { role: "status" }, summary(proof, errors.length)),
    ...proof.problems.map((one) => problemBox(one, one.severity)),
    saving,
    h("h2", null, "Person and model"),
    personForm(draft, known),
    facts(proof),
    h("h2", null, "Files"),
    fileTable(proof, draft, known.bones),
  );
  main.append(h("div", { class: "beside" }, inSpace(proof, job, place, markers, signal), markers.element));
}

function summary(proof: ProofDocument, errors: number): string {
  const read = `${plural(proof.recordings.length, "recording")} in ${plural(proof.files.length, "file")} can be read.`;
  return errors === 0 ? `${read} Nothing stands in the way.` : `${read} ${plural(errors, "problem")} to solve first:`;
}

function actions(draft: Draft, open: boolean, next: string): HTMLElement[] {
  const failed = h("div");
  const save = async (): Promise<void> => {
    await putSubject(draft.finished() as SubjectDocument);
    again();
  };
  const button = h("button", { class: "main", onclick: () => void guarded(failed, save) }, "Save and check again");
  const onwards = h("a", { class: "button main", href: next }, "On to the methods");
  return [h("div", { class: "actions" }, open ? button : onwards, open && h("span", { class: "quiet" }, "Not saved yet.")), failed];
}

function inSpace(
  proof: ProofDocument,
  job: string,
  place: Context["place"],
  markers: MarkerMap,
  signal: AbortSignal,
): HTMLElement {
  const [first] = [...proof.recordings].sort((a, b) => b.walked_m - a.walked_m);
  if (first === undefined) return h("section");
  const box = h("div");
  const failed = h("div");
  let leaving = new AbortController();
  const show = async (name: string): Promise<void> => {
    leaving.abort();
    leaving = new AbortController();
    const recording = proof.recordings.find((one) => one.file === name) ?? first;
    const preview = new Preview(recording, (file) => filePath(job, file), (label) => markers.clicked(label), AbortSignal.any([signal, leaving.signal]));
    markers.show = (label) => preview.mark(label);
    fill(box, orientation(recording, proof, place), preview.element);
    await preview.begin();
  };
  const names = proof.recordings.map(({ file }) => ({ value: file, text: file }));
  void guarded(failed, () => show(first.file));
  const chooser = select("Recording", names, first.file, (name) => void guarded(failed, () => show(name)));
  return h("section", null, h("h2", null, "In space"), chooser, failed, box);
}
