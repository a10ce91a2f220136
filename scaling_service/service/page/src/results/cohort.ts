/** A cohort: how each subject ended, and the methods compared over all of them. */

import { ask, getResult } from "../api/jobs.ts";
import type { CohortDocument, SubjectEntry } from "../api/schema.ts";
import { toJob } from "../routes.ts";
import { bullets, callout } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { guarded, sentence } from "../ui/problem.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { number } from "../ui/words.ts";
import { agreement } from "./agreement.ts";
import { cohortAngles } from "./cohortangles.ts";
import { quantities } from "./quantities.ts";
import { parts, type Finished, type ResultView } from "./result.ts";

export const cohort: ResultView = async (found) => {
  const document = await getResult<CohortDocument>(found.job.id, found.signal);
  const { statistics } = document;
  await parts("Parts of the cohort", found, [
    { name: "subjects", title: "Subjects", show: (place) => subjects(document, found, place) },
    { name: "errors", title: "Errors", show: (place) => quantities(statistics, ["kinematic_error_mm"], found.signal, place) },
    { name: "sizes", title: "Sizes", show: (place) => quantities(statistics, ["segment_lengths_mm", "knee_axis_deg", "marker_shift_mm", "from_truth_mm", "from_truth_deg"], found.signal, place) },
    { name: "angles", title: "Angles", show: (place) => cohortAngles(statistics.joint_angles, found.signal, place) },
    { name: "agreement", title: "Agreement", show: (place) => agreement(statistics, found.signal, place) },
  ]);
};

function subjects({ subjects: all, statistics, notes, headline, why }: CohortDocument, found: Finished, place: HTMLElement): void {
  const failed = h("div");
  const groups = [...new Set(all.flatMap((one) => Object.keys(one.groups)))];
  const methods = [...new Set(all.flatMap((one) => one.methods))];
  const errors = statistics.kinematic_error_mm.find(({ quantity }) => quantity === "evaluation");
  place.append(
    headline === "" ? "" : callout(headline, "plain", bullets(why)),
    failed,
    table({
      caption: "How every subject ended",
      note: "A subject's name leads to its own comparison.",
      name: "subjects",
      columns: [{ title: "subject" }, { title: "ended" }, ...groups.map((title) => ({ title, words: true })), { title: "strides" },
        ...methods.map((method) => ({ title: `${method}, mm held out` })), { title: "why", words: true }, { title: "time, s" }],
      rows: all.map((one): Cell[] => [
        { text: one.id, node: opening(one, found, failed) },
        cell(one.status, undefined, one.status === "done" ? "good" : one.status === "failed" ? "poor" : "unknown"),
        ...groups.map((name) => cell(one.groups[name] ?? "")),
        cell(Object.entries(one.strides).map(([leg, count]) => `${leg === "r" ? "right" : "left"} ${count}`).join(", "), Object.values(one.strides).reduce((sum, count) => sum + count, 0)),
        ...methods.map((method) => cell(number(errors?.values[one.id]?.[method]), errors?.values[one.id]?.[method] ?? null)),
        cell(said(one) || "–"),
        cell(number(one.wall_s), one.wall_s),
      ]),
      filter: true,
    }),
    notes.length + statistics.notes.length > 0 ? bullets([...notes, ...statistics.notes].map(sentence)) : "",
  );
}

function said({ reason, left_out }: SubjectEntry): string {
  return [reason, ...Object.entries(left_out).map(([method, why]) => `no ${method}: ${why}`)].filter((text) => text !== "").join("; ");
}

/** The same comparison of this subject alone; what was computed before comes back at once. */
function opening({ id, status, folder }: SubjectEntry, { request }: Finished, failed: HTMLElement): HTMLElement {
  if (status !== "done") return h("span", null, id);
  if (request["subjects"] === undefined && folder !== null) return h("a", { href: `${folder.split("/").map(encodeURIComponent).join("/")}/report.html` }, id);
  const { methods, settings } = request;
  const open = async (): Promise<void> => {
    location.hash = toJob((await ask("comparisons", { subject: id, methods, settings })).id);
  };
  return h("button", { class: "linked", onclick: () => void guarded(failed, open) }, id);
}
