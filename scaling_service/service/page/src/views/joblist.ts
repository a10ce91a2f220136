/** A list of jobs that keeps itself up to date. */

import { isOver, jobsOf } from "../api/events.ts";
import { end, getOrigin } from "../api/jobs.ts";
import type { JobDocument, Specification } from "../api/schema.ts";
import { toJob } from "../routes.ts";
import { fill, h } from "../ui/dom.ts";
import { duration, kindInWords, moment } from "../ui/words.ts";
import { isCounted, leftInWords, stateInWords } from "../ui/working.ts";

interface Options {
  compact?: boolean;
}

export function jobList(jobs: readonly JobDocument[], signal: AbortSignal, { compact = false }: Options = {}): HTMLElement {
  return h("ul", { class: compact ? "jobs compact" : "jobs" }, ...jobs.map((job) => entry(job, signal, compact)));
}

function entry(job: JobDocument, signal: AbortSignal, compact: boolean): HTMLElement {
  const state = h("span", { class: `state ${job.state}` });
  const bar = h("progress", { max: 1, "aria-label": "How far the job is" });
  const about = h("span", { class: "quiet" });
  const cancel = h("button", { class: "small", onclick: () => void end(job.id) }, "Cancel");
  cancel.setAttribute("aria-label", `Cancel: ${kindInWords(job.kind)}`);
  const failed = h("p", { class: "quiet" });
  const show = (latest: JobDocument): void => {
    state.className = `state ${latest.state}`;
    state.textContent = isOver(latest) ? latest.state : [stateInWords(latest), leftInWords(latest)].filter((part) => part !== "").join("; ");
    cancel.hidden = isOver(latest);
    bar.hidden = !isCounted(latest);
    bar.value = latest.progress.share;
    fill(failed, latest.failure !== null && `${latest.failure.problem}. ${latest.failure.remedy ?? ""}`);
  };
  show(job);
  if (!isOver(job)) void follow(job, show, signal);
  void getOrigin(job.id).then(({ specification }) => {
    about.textContent = ` ${aboutOf(specification)}`;
  }).catch(() => undefined);
  return h(
    "li",
    null,
    h("a", { href: toJob(job.id) }, kindInWords(job.kind)),
    about,
    h("span", { class: "push" }),
    state,
    cancel,
    bar,
    h("span", { class: "quiet" }, compact ? moment(job.created_at) : `${moment(job.created_at)}${tookOf(job)}`),
    !compact && failed,
  );
}

async function follow(job: JobDocument, show: (job: JobDocument) => void, signal: AbortSignal): Promise<void> {
  for await (const latest of jobsOf(job.id, job.revision, signal)) show(latest);
}

function tookOf({ started_at, finished_at }: JobDocument): string {
  if (started_at === null || finished_at === null) return "";
  return `, ${duration((Date.parse(finished_at) - Date.parse(started_at)) / 1000)}`;
}

/** Whose data a job rests on, and the methods, as far as its specification tells. */
function aboutOf({ request }: Specification): string {
  const subject = request.subject ?? (Array.isArray(request.subjects) ? `${request.subjects.length} subjects` : "");
  const methods = Array.isArray(request.methods) ? request.methods.join(", ") : (request.method ?? request.start ?? "");
  return [subject, methods].filter((part) => part !== "" && part !== null).join(": ");
}
