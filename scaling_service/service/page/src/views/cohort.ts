/** The cohort: many subjects brought in at once, chosen, and compared. */

import { ask, listJobs } from "../api/jobs.ts";
import { listSubjects } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { bring } from "../intake/bringing.ts";
import { cohortOf, takeKept } from "../intake/cohort.ts";
import type { Entry } from "../intake/entries.ts";
import { Problem } from "../api/problem.ts";
import type { MethodWord, SubjectSummary } from "../api/schema.ts";
import { toJob, toSubject } from "../routes.ts";
import { box, group } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { styleOf } from "../ui/palette.ts";
import { guarded, problemBox } from "../ui/problem.ts";
import { cell, chipOf, table, type Cell } from "../ui/table.ts";
import { moment, plural } from "../ui/words.ts";
import { dropBox } from "./drop.ts";
import { jobList } from "./joblist.ts";
import type { View } from "./view.ts";

interface Picked {
  subjects: Set<string>;
  methods: Set<string>;
  groups: Record<string, Record<string, string>>;
}

export const cohort: View = async ({ main, signal }) => {
  const [subjects, known, jobs] = await Promise.all([listSubjects(signal), vocabulary(), listJobs({ kind: "batch", limit: "20" }, signal)]);
  const picked: Picked = { subjects: new Set(), methods: new Set(known.methods.map(({ name }) => name)), groups: {} };
  const list = h("div");
  const status = h("p", { class: "quiet", role: "status" });
  const failed = h("div");
  const take = (entries: Promise<Entry[]> | Entry[]): void =>
    void guarded(failed, async () => {
      await bringAll(await entries, picked, status, failed);
      fill(list, chooser(await listSubjects(signal), picked));
    });
  fill(list, chooser(subjects, picked));
  main.append(
    h("h1", null, "Cohort"),
    dropBox(take, h("p", null, "Drop a folder with one subject file for each person beside their recordings; a table (CSV with a column “subject”) may add groups."), status),
    failed,
    list,
    ...starting(picked, known.methods),
    h("h2", null, "Cohorts that were compared"),
    jobs.items.length === 0 ? h("p", { class: "quiet" }, "None yet.") : jobList(jobs.items, signal),
  );
  const kept = takeKept();
  if (kept !== null) take(kept);
};

/** Bring all members in; one that fails does not stop the others. */
async function bringAll(entries: readonly Entry[], picked: Picked, status: HTMLElement, failed: HTMLElement): Promise<void> {
  const { members, groups } = await cohortOf(entries);
  if (members.length === 0) {
    throw new Problem({ problem: "No subject file is among these files", remedy: "Put a subject.yaml beside the recordings of each person; the README shows one" });
  }
  Object.assign(picked.groups, groups);
  const problems: HTMLElement[] = [];
  for (const [place, member] of members.entries()) {
    const id = member.document?.subject.id ?? "";
    try {
      await bring(member, id, (text) => void (status.textContent = `Subject ${place + 1} of ${members.length}, ${id}. ${text}`));
      picked.subjects.add(id);
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      problems.push(problemBox({ ...error, problem: error.problem, file: member.path }));
    }
  }
  status.textContent = `${plural(picked.subjects.size, "subject")} brought in.`;
  fill(failed, ...problems);
}

function chooser(subjects: readonly SubjectSummary[], picked: Picked): HTMLElement {
  const rows = subjects.map(({ id, updated_at }): Cell[] => {
    const one = box(id, picked.subjects.has(id), (wanted) => void (wanted ? picked.subjects.add(id) : picked.subjects.delete(id)));
    const labels = Object.entries(picked.groups[id] ?? {}).map(([name, value]) => `${name} ${value}`).join(", ");
    return [{ text: id, value: id, node: one }, cell(labels || "–"), cell(moment(updated_at), updated_at), { text: "", node: h("a", { href: toSubject(id) }, "recordings") }];
  });
  if (rows.length === 0) return h("p", { class: "quiet" }, "No subjects yet.");
  return table({ caption: "Who belongs to the cohort", name: "subjects", filter: true, rows,
    columns: [{ title: "subject" }, { title: "groups", words: true }, { title: "changed" }, { title: "" }] });
}

function starting(picked: Picked, methods: readonly MethodWord[]): HTMLElement[] {
  const failed = h("div");
  const start = (): void =>
    void guarded(failed, async () => {
      if (picked.subjects.size === 0) throw new Problem({ problem: "Nobody is chosen", remedy: "Tick the subjects of the cohort" });
      const subjects = [...picked.subjects];
      const groups = Object.fromEntries(subjects.flatMap((id) => (picked.groups[id] === undefined ? [] : [[id, picked.groups[id]]])));
      const all = methods.every(({ name }) => picked.methods.has(name));
      const wanted = methods.map(({ name }) => name).filter((name) => picked.methods.has(name));
      const request = { subjects, groups, ...(all ? {} : { methods: wanted }) };
      location.hash = toJob((await ask("batches", request)).id);
    });
  const boxes = methods.map(({ name }) =>
    box(h("span", null, chipOf(styleOf(name).colour), ` ${name}`), true, (wanted) => void (wanted ? picked.methods.add(name) : picked.methods.delete(name))));
  return [
    group("Methods", ...boxes),
    h("p", { class: "note" }, "With all methods, each subject takes those that its recordings allow."),
    h("div", { class: "actions" }, h("button", { class: "main", onclick: start }, "Compare the cohort")),
    failed,
  ];
}
