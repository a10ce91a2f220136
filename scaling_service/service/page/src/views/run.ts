/** Choose what is computed; what runs and what ran stands below. */

import { ask, listJobs } from "../api/jobs.ts";
import type { JobDocument, MethodWord, SubjectDetail } from "../api/schema.ts";
import { getSubject } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { toJob } from "../routes.ts";
import { box, group, select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { styleOf } from "../ui/palette.ts";
import { chipOf } from "../ui/table.ts";
import { jobList } from "./joblist.ts";
import { Chosen } from "./settings.ts";
import { subjectHead } from "./subjecthead.ts";
import type { View } from "./view.ts";

export const run: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  const [subject, known] = await Promise.all([getSubject(id, signal), vocabulary()]);
  const history = h("div");
  const begin = (job: JobDocument, follow: boolean): void => {
    if (follow) location.hash = toJob(job.id);
    else history.prepend(jobList([job], signal));
  };
  const chosen = new Chosen(place.query);
  const methods = known.methods.filter((method) => subject.document.bones !== undefined || !method.needs_images);
  main.append(
    subjectHead(id, "run"),
    comparing(subject, methods, chosen, begin),
    h("div", { class: "cards" }, ...others(subject, known.methods, chosen, begin)),
    chosen.element,
    h("h2", null, "What ran on this subject"),
    history,
  );
  const jobs = await listJobs({ subject: id, limit: "20" }, signal);
  history.append(jobs.items.length === 0 ? h("p", { class: "quiet" }, "Nothing yet.") : jobList(jobs.items, signal));
};

type Begin = (job: JobDocument, follow: boolean) => void;

function comparing(subject: SubjectDetail, methods: MethodWord[], chosen: Chosen, begin: Begin): HTMLElement {
  const picked = new Set(methods.map((method) => method.name));
  const failed = h("div");
  const boxes = methods.map(({ name, meaning }) => {
    const label = h("span", { class: "method" }, chipOf(styleOf(name).colour), h("b", null, name), ` ${meaning}`);
    return box(label, true, (checked) => void (checked ? picked.add(name) : picked.delete(name)));
  });
  const start = (): void =>
    void guarded(failed, async () => {
      const wanted = methods.map((method) => method.name).filter((name) => picked.has(name));
      begin(await ask("comparisons", { subject: subject.id, methods: wanted, settings: chosen.settings() }), true);
    });
  return h(
    "section",
    { class: "card" },
    h("h2", null, "Scale by several methods and compare them"),
    h("div", { class: "methods" }, group("Methods", ...boxes)),
    h("div", { class: "actions" }, h("button", { class: "main", onclick: start }, "Compare")),
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
    about: "Residual forces against published limits, and whether errors of measurement explain them. Needs forces, and a model with feet." },
  { route: "consistent-motions", title: "Motion that forces agree with",
    about: "The motion, segment lengths and inertia that markers and ground forces agree on. Needs both feet on plates." },
];

function others(subject: SubjectDetail, methods: MethodWord[], chosen: Chosen, begin: Begin): HTMLElement[] {
  return OTHERS.map(({ route, title, about }) => {
    const failed = h("div");
    let from = "";
    const start = (): void =>
      void guarded(failed, async () => {
        const request = { subject: subject.id, ...(from === "" ? {} : { start: from }), ...chosen.axes() };
        begin(await ask(route, request), false);
      });
    const starts = [{ value: "", text: "the best that there is" }, { value: "none", text: "the model as it is" },
      ...methods.map(({ name }) => ({ value: name, text: name }))];
    return h(
      "section",
      { class: "card" },
      h("h2", null, title),
      h("p", { class: "quiet" }, about),
      h("div", { class: "actions" }, select("start from", starts, "", (value) => void (from = value)),
        h("button", { onclick: start, "aria-label": `Start: ${title}` }, "Start")),
      failed,
    );
  });
}
