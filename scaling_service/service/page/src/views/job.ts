/** One job: its progress while it runs, then what it found. */

import { part } from "../api/connection.ts";
import { Problem } from "../api/problem.ts";
import { end, finished, getJob, getOrigin } from "../api/jobs.ts";
import type { JobDocument, Origin } from "../api/schema.ts";
import { link, toSubject } from "../routes.ts";
import { viewOf } from "../results/views.ts";
import { confirmed } from "../ui/dialog.ts";
import { h } from "../ui/dom.ts";
import { guarded, problemBox } from "../ui/problem.ts";
import { kindInWords, moment } from "../ui/words.ts";
import { working } from "../ui/working.ts";
import type { View } from "./view.ts";

export const job: View = async ({ main, place, signal }) => {
  const id = place.parts[1] ?? "";
  if (!/^[0-9a-f]{64}$/.test(id)) throw new Problem({ problem: "There is no such job", remedy: "Choose one under Jobs" });
  const [first, origin] = await Promise.all([getJob(id, signal), getOrigin(id)]);
  const progress = working();
  const failed = h("div");
  main.append(head(first, origin, failed), failed, progress.element);
  await guarded(failed, async () => {
    const done = await finished(first, progress.show, signal);
    if (signal.aborted) return;
    const view = await viewOf(done.kind);
    const { takeAway } = await part(() => import("../results/takeaway.ts"));
    await view({ job: done, request: origin.specification.request, takeAway, main, place, signal });
  });
  if (first.failure !== null && failed.childElementCount === 0) failed.append(problemBox(first.failure));
};

function head(job: JobDocument, { specification }: Origin, failed: HTMLElement): HTMLElement {
  const { subject } = specification.request;
  const remove = async (): Promise<void> => {
    if (!(await confirmed("Delete this job and all that it made, for good?", "Delete"))) return;
    await end(job.id);
    location.hash = link(["jobs"]);
  };
  return h(
    "div",
    null,
    h(
      "p",
      { class: "crumbs" },
      h("a", { href: link(["jobs"]) }, "Jobs"),
      typeof subject === "string" && " / ",
      typeof subject === "string" && h("a", { href: toSubject(subject, "run") }, subject),
    ),
    h(
      "div",
      { class: "bar" },
      h("h1", null, kindInWords(job.kind), typeof subject === "string" && `: ${subject}`),
      h("span", { class: "push" }),
      h("span", { class: "quiet" }, moment(job.created_at)),
      h("button", { class: "small", onclick: () => void guarded(failed, remove) }, "Delete"),
    ),
  );
}
