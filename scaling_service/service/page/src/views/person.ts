/** The report of a person, beside another session where one is chosen. */

import { listJobs } from "../api/jobs.ts";
import { getSubject, listSubjects } from "../api/subjects.ts";
import { vocabulary } from "../api/vocabulary.ts";
import { besides, CHAPTERS, personChapters, personHead, type Newest } from "../results/person.ts";
import { link } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { noteSection } from "./note.ts";
import { subjectHead } from "./subjecthead.ts";
import type { View } from "./view.ts";

async function newestOf(subject: string, signal: AbortSignal): Promise<Newest> {
  const found = await Promise.all(CHAPTERS.map((kind) => listJobs({ subject, kind, state: "done", limit: "1" }, signal)));
  return Object.fromEntries(CHAPTERS.flatMap((kind, k) => { const [job] = found[k]?.items ?? []; return job === undefined ? [] : [[kind, job]]; }));
}

export const person: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  const other = place.query.get("beside") ?? "";
  const [subject, known, all, newest] = await Promise.all([getSubject(id, signal), vocabulary(), listSubjects(signal), newestOf(id, signal)]);
  const sessions = [{ value: "", text: "none" }, ...all.filter((one) => one.id !== id).map((one) => ({ value: one.id, text: one.id }))];
  main.append(
    subjectHead(id, "report"),
    h("div", { class: "actions" }, h("button", { class: "main", onclick: () => print() }, "Print"),
      select("beside another session", sessions, other, (value) => void (location.hash = link(place.parts, value === "" ? {} : { beside: value })))),
    personHead(subject),
    ...(await personChapters(id, newest, known, signal)),
  );
  const results = CHAPTERS.flatMap((kind) => newest[kind]?.id ?? []);
  const written = await noteSection(id, results, signal);
  const theirs = other === "" ? null : await newestOf(other, signal);
  if (theirs !== null) main.append(newest.scaling === undefined || theirs.scaling === undefined
    ? h("p", null, `Models of both ${id} and ${other} must have been compared before they can stand beside each other.`)
    : await besides([id, other], [newest.scaling, theirs.scaling], known, signal));
  main.append(written);
};
