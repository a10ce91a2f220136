/** Choose what is computed, with what each analysis needs; what runs and what ran stands below. */

import { ask, listJobs } from "../api/jobs.ts";
import type { JobDocument, MethodWord, ProofDocument, Readiness, SubjectDetail, SubjectDocument, Vocabulary } from "../api/schema.ts";
import { getSubject, putSubject } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { laboratoryMap } from "../imports/markermap.ts";
import { proofOf } from "../imports/proof.ts";
import { needList } from "../imports/readiness.ts";
import { link, toJob } from "../routes.ts";
import { box, group, select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { guarded, problemBox } from "../ui/problem.ts";
import { styleOf } from "../ui/palette.ts";
import { chipOf } from "../ui/table.ts";
import { working } from "../ui/working.ts";
import { jobList } from "./joblist.ts";
import { Chosen } from "./settings.ts";
import { subjectHead } from "./subjecthead.ts";
import type { Context, View } from "./view.ts";

export const run: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  const [given, known, laboratory] = await Promise.all([getSubject(id, signal), vocabulary(), laboratoryMap()]);
  main.append(subjectHead(id, "run"));
  const progress = working("Looking at the files");
  const failed = h("div");
  main.append(failed, progress.element);
  await guarded(failed, async () => {
    const { result } = await proofOf(id, place, laboratory, progress.show, signal);
    const complete = given.document.model !== undefined && given.document.trials !== undefined;
    const subject = complete || result.proposal === null ? given : await putSubject(result.proposal as unknown as SubjectDocument);
    if (!signal.aborted) await chooser({ main, place, signal }, subject, known, result);
  });
};

async function chooser({ main, place, signal }: Context, subject: SubjectDetail, known: Vocabulary, proof: ProofDocument): Promise<void> {
  const { id } = subject;
  const history = h("div");
  const begin = (job: JobDocument, follow: boolean): void => {
    if (follow) location.hash = toJob(job.id);
    else {
      const started = jobList([job], signal);
      history.prepend(started);
      started.scrollIntoView({ block: "center" });
    }
  };
  const chosen = new Chosen(place.query);
  const methods = known.methods.filter((method) => subject.document.bones !== undefined || !method.needs_images);
  const needsOf = (route: string): Readiness | undefined => proof.readiness.find(({ analysis }) => analysis === route);
  main.append(
    unsolved(proof, id),
    comparing(subject, methods, chosen, begin, needsOf("comparisons")),
    h("div", { class: "cards" }, ...others(subject, known.methods, chosen, begin, needsOf)),
    chosen.element,
    h("h2", null, "What ran on this subject"),
    history,
  );
  const jobs = await listJobs({ subject: id, limit: "20" }, signal);
  const analyses = jobs.items.filter(({ kind }) => kind !== "proof");
  history.append(analyses.length === 0 ? h("p", { class: "quiet" }, "Nothing yet.") : jobList(analyses, signal));
}

/** What keeps every analysis from running, and the way to put it right. */
function unsolved({ problems }: ProofDocument, id: string): HTMLElement {
  const errors = problems.filter(({ severity }) => severity === "error");
  return h("section", { hidden: errors.length === 0 }, ...errors.map((error) => problemBox(error)),
    h("p", { class: "actions" }, h("a", { class: "button", href: link(["subjects", id, "import"]) }, "Back to the recordings")));
}

/** What an analysis needs; what lacks is given on the first page. */
function needs(subject: SubjectDetail, readiness: Readiness | undefined): HTMLElement | false {
  if (readiness === undefined) return false;
  return needList(readiness.needs, (what) => void (location.hash = link(["subjects", subject.id, "import"], { give: what })));
}

type Begin = (job: JobDocument, follow: boolean) => void;

function comparing(subject: SubjectDetail, methods: MethodWord[], chosen: Chosen, begin: Begin, readiness: Readiness | undefined): HTMLElement {
  const picked = new Set(methods.map(({ name }) => name));
  const failed = h("div");
  let muscles = false;
  const boxes = methods.map(({ name, meaning }) => {
    const label = h("span", { class: "method" }, chipOf(styleOf(name).colour), h("b", null, name), ` ${meaning}`);
    return box(label, true, (checked) => void (checked ? picked.add(name) : picked.delete(name)));
  });
  const start = (): void =>
    void guarded(failed, async () => {
      const wanted = methods.map((method) => method.name).filter((name) => picked.has(name));
      begin(await ask("comparisons", { subject: subject.id, methods: wanted, muscles, settings: chosen.settings(), ...chosen.written(), ...chosen.exported() }), true);
    });
  return h(
    "section",
    { class: "card" },
    h("h2", null, "Scale by several methods and compare them"),
    needs(subject, readiness),
    h("div", { class: "methods" }, group("Methods", ...boxes)),
    String(subject.document.model).toLowerCase().endsWith(".osim")
      ? box("Muscles: lengths, moment arms and joint moments by method", false, (checked) => void (muscles = checked))
      : null,
    h("div", { class: "actions" }, h("button", { class: "main", disabled: readiness?.ready === false, onclick: start }, "Compare")),
    failed,
  );
}

interface Other {
  route: string;
  title: string;
  about: string;
}

const OTHERS: Other[] = [
  { route: "discoveries", title: "Find the missing effect",
    about: "Looks where model and recordings disagree beyond noise, names the effect, adds it, and checks on unseen data." },
  { route: "dynamics", title: "Check the forces",
    about: "Residual forces against published limits, and whether errors of measurement explain them." },
  { route: "consistent-motions", title: "Motion that forces agree with",
    about: "The motion, segment lengths and inertia that markers and ground forces agree on." },
];

function others(subject: SubjectDetail, methods: MethodWord[], chosen: Chosen, begin: Begin, needsOf: (route: string) => Readiness | undefined): HTMLElement[] {
  return OTHERS.map(({ route, title, about }) => {
    const failed = h("div");
    let from = "";
    const start = (): void =>
      void guarded(failed, async () => {
        const request = { subject: subject.id, ...(from === "" ? {} : { start: from }), ...chosen.axes(), ...chosen.written() };
        begin(await ask(route, request), false);
      });
    const starts = [{ value: "", text: "the best available scaling" }, { value: "none", text: "the model as it is" },
      ...methods.map(({ name }) => ({ value: name, text: name }))];
    return h(
      "section",
      { class: "card" },
      h("h2", null, title),
      h("p", { class: "quiet" }, about),
      needs(subject, needsOf(route)),
      h("div", { class: "actions" }, select("start from", starts, "", (value) => void (from = value)),
        h("button", { disabled: needsOf(route)?.ready === false, onclick: start, "aria-label": `Start: ${title}` }, "Start")),
      failed,
    );
  });
}
