/** A job that is under way: what it does, how far it is, and how to stop it. */

import { isOver } from "../api/events.ts";
import { end } from "../api/jobs.ts";
import type { JobDocument } from "../api/schema.ts";
import { h } from "./dom.ts";
import { kindInWords } from "./words.ts";

export interface Working {
  element: HTMLElement;
  show: (job: JobDocument) => void;
}

/** Shows a job until it is over, then goes away. */
export function working(title?: string): Working {
  const name = h("p");
  const bar = h("progress", { max: 1, "aria-label": "How far the job is" });
  const status = h("p", { class: "quiet", role: "status" });
  let latest: JobDocument | null = null;
  const cancel: HTMLButtonElement = h("button", { class: "small", onclick: () => {
    cancel.disabled = true;
    if (latest !== null) void end(latest.id);
  } }, "Cancel");
  const element = h("div", { class: "working" }, h("div", { class: "bar" }, name, h("span", { class: "push" }), cancel), bar, status);
  return {
    element,
    show(job) {
      latest = job;
      element.hidden = isOver(job);
      name.textContent = title ?? kindInWords(job.kind);
      status.textContent = stateInWords(job);
      if (isCounted(job)) bar.value = job.progress.share;
      else bar.removeAttribute("value");
    },
  };
}

/** Whether its share tells how far it is. */
export const isCounted = ({ state }: JobDocument): boolean => state === "running" || state === "waiting";

export function stateInWords(job: JobDocument): string {
  const { what, share } = job.progress;
  switch (job.state) {
    case "waiting":
      return `${Math.round(100 * share)} %, ${what}`;
    case "queued":
      return what === "" || what === "waiting" ? "waits for its turn" : `waits: ${what}`;
    case "running":
      return `${Math.round(100 * share)} %${what === "" ? "" : `, ${what}`}${job.attempt > 1 ? ` (begun ${job.attempt} times)` : ""}`;
    case "cancelling":
      return "is being cancelled";
    default:
      return job.state;
  }
}
