/** Import in three steps, before anything runs: the files and the person, the markers, the laboratory's space. */

import { filePath } from "../api/jobs.ts";
import type { Correction, GaitEventEntry, MarkerMapDocument, ProofDocument, SubjectDetail, SubjectDocument, Vocabulary } from "../api/schema.ts";
import { getSubject } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { Draft } from "../imports/draft.ts";
import { eventList } from "../imports/events.ts";
import { facts } from "../imports/facts.ts";
import { fileTable } from "../imports/files.ts";
import { laboratoryMap, MarkerMap } from "../imports/markermap.ts";
import { orientation } from "../imports/orientation.ts";
import { personForm } from "../imports/person.ts";
import { Preview } from "../imports/preview.ts";
import { mending } from "../imports/mending.ts";
import { proofOf } from "../imports/proof.ts";
import { readinessOf } from "../imports/readiness.ts";
import { Saver } from "../imports/saver.ts";
import { again, link, note } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { guarded, problemList } from "../ui/problem.ts";
import { Steps } from "../ui/steps.ts";
import { correctionInWords, plural } from "../ui/words.ts";
import { working } from "../ui/working.ts";
import { dropZone } from "./drop.ts";
import { subjectHead } from "./subjecthead.ts";
import type { Context, View } from "./view.ts";

export const importing: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  const [subject, known, laboratory] = await Promise.all([getSubject(id, signal), vocabulary(), laboratoryMap()]);
  main.append(subjectHead(id, "import"));
  if (subject.files.length === 0) main.append(dropZone(id));
  else await checked({ main, place, signal }, subject, known, laboratory);
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
  await guarded(failed, async () => {
    const { job, result } = await proofOf(subject.id, place, laboratory, progress.show, signal);
    if (!signal.aborted) shown({ main: content, place, signal }, subject, result, job.id, known, laboratory);
  });
  if (content.childElementCount === 0) main.append(dropZone(subject.id));
}

function shown(
  { main, place, signal }: Context,
  subject: SubjectDetail,
  proof: ProofDocument,
  job: string,
  known: Vocabulary,
  laboratory: MarkerMapDocument,
): void {
  const complete = subject.document.model !== undefined && subject.document.trials !== undefined;
  const given = structuredClone((complete ? subject.document : proof.proposal) ?? subject.document) as unknown as SubjectDocument;
  const summary = h("section", { class: "summary" });
  const saver = new Saver(() => draft.finished(), async () => {
    const { result } = await proofOf(subject.id, place, laboratory, () => undefined, signal);
    if (signal.aborted) return;
    markers.take(result);
    summarise(result);
  }, signal);
  const draft = new Draft(given, () => {
    saver.touch();
    markers.follow();
  });
  const markers = new MarkerMap(proof, draft, laboratory);
  const keep = async (file: string, correction: Correction): Promise<void> => {
    draft.correct(file, correction);
    await saver.flush();
    again();
  };
  const keepEvents = async (file: string, events: GaitEventEntry[] | null): Promise<void> => {
    draft.events(file, events);
    await saver.flush();
    note({ recording: file });
    again();
  };
  const space = inSpace(proof, job, place, markers, { correct: keep, events: keepEvents }, signal);

  const steps = new Steps("Steps of the import", [
    { name: "files", title: "Files and person", panel: [
      h("h2", null, "Person and model"), personForm(draft, known), facts(proof),
      h("h2", null, "Files"), fileTable(proof, draft, known.bones), dropZone(subject.id)] },
    { name: "markers", title: "Markers", panel: [h("div", { class: "beside" }, space.home, markers.element)] },
    { name: "space", title: "Laboratory", panel: [h("div", { class: "beside" }, space.place, space.facts)] },
  ], place.query.get("step") ?? "files", (name) => void (name === "space" ? space.place : space.home).append(space.stage));

  function summarise(found: ProofDocument): void {
    fill(
      summary,
      h("p", { role: "status", class: "headline" }, `${plural(found.recordings.length, "recording")} in ${plural(found.files.length, "file")} can be read. ${found.headline}.`),
      readinessOf(found.readiness, (what) => steps.give(what)),
      problemList(found.problems, {
        correct: (file, { labels, from_s, to_s }) => void keep(file, { labels, from_s, to_s }),
        give: (field) => steps.give(field),
      }),
    );
  }
  summarise(proof);
  const wanted = place.query.get("give");
  if (wanted !== null) queueMicrotask(() => steps.give(wanted));
  const next = link(["subjects", subject.id, "run"], Object.fromEntries([...place.query].filter(([name]) => name !== "step" && name !== "give")));
  main.append(
    summary,
    corrections(given, (file) => {
      draft.correct(file, null);
      void saver.flush().then(again);
    }),
    h("div", { class: "saving" }, steps.links, h("span", { class: "push" }), saver.status, h("a", { class: "button main", href: next }, "On to the analyses")),
    saver.failed,
    ...steps.panels,
  );
}

/** What the subject's document corrects, with a way back. */
function corrections({ corrections: all = {} }: SubjectDocument, undo: (file: string) => void): HTMLElement {
  const rows = Object.entries(all).map(([file, found]) =>
    h("li", null, `${file}: ${found.map(correctionInWords).join("; ")} `, h("button", { class: "small", onclick: () => undo(file) }, "Undo")));
  return h("section", { hidden: rows.length === 0 }, h("h2", null, "Labels put right"), h("ul", null, ...rows));
}

interface Space {
  /** The recording in space, and where it stands with the markers and alone. */
  stage: HTMLElement;
  home: HTMLElement;
  place: HTMLElement;
  facts: HTMLElement;
}

interface Keep {
  correct: (file: string, correction: Correction) => Promise<void>;
  events: (file: string, events: GaitEventEntry[] | null) => Promise<void>;
}

function inSpace(proof: ProofDocument, job: string, place: Context["place"], markers: MarkerMap, keep: Keep, signal: AbortSignal): Space {
  const [home, alone, facts, box, mend, failed] = [h("div"), h("div"), h("section"), h("div"), h("div"), h("div")];
  const labels = [...new Set([...proof.recordings.flatMap((one) => one.labels.map(({ label }) => label)), ...proof.markers.map(({ marker }) => marker)])].sort();
  const wanted = place.query.get("recording");
  const [first] = [...proof.recordings].sort((a, b) => Number(b.file === wanted) - Number(a.file === wanted) || b.walked_m - a.walked_m);
  if (first === undefined) return { stage: box, home, place: alone, facts };
  let leaving = new AbortController();
  const show = async (name: string): Promise<void> => {
    leaving.abort();
    leaving = new AbortController();
    const recording = proof.recordings.find((one) => one.file === name) ?? first;
    const end_s = recording.start_s + (recording.frames - 1) / recording.rate_hz;
    const picked = (label: string | null): void => {
      if (!markers.clicked(label)) return;
      fill(mend, label !== null && mending({ file: recording.file, label, labels, span: [recording.start_s, end_s] }, () => preview.now, "Put it right",
        (correction) => keep.correct(recording.file, correction)));
    };
    const preview = new Preview(recording, (file) => filePath(job, file), markers.names(), picked, AbortSignal.any([signal, leaving.signal]));
    markers.show = (label) => preview.mark(label);
    fill(mend);
    fill(box, preview.element, mend);
    fill(facts, orientation(recording, proof, place),
      eventList(recording, () => preview.now, (time_s) => preview.go(time_s), (events) => void guarded(failed, () => keep.events(recording.file, events))), preview.gaps);
    await preview.begin();
  };
  const names = proof.recordings.map(({ file }) => ({ value: file, text: file }));
  void guarded(failed, () => show(first.file));
  const chooser = select("Recording", names, first.file, (name) => void guarded(failed, () => show(name)));
  const stage = h("section", null, h("h2", { class: "sr" }, "In space"), chooser, failed, box);
  return { stage, home, place: alone, facts };
}
