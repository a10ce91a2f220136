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
  let running = false;
  const cancel: HTMLButtonElement = h("button", { class: "small", onclick: () => {
    cancel.disabled = true;
    if (latest !== null) void end(latest.id);
  } }, "Cancel");
  const left = h("p", { class: "quiet" });
  const tell = noticeButton();
  const element = h("div", { class: "working" }, h("div", { class: "bar" }, name, h("span", { class: "push" }), tell, cancel), bar, status, left);
  return {
    element,
    show(job) {
      latest = job;
      element.hidden = isOver(job);
      name.textContent = title ?? kindInWords(job.kind);
      status.textContent = stateInWords(job);
      left.textContent = leftInWords(job);
      if (!isOver(job)) running = true;
      else if (running) notify(job);
      if (isCounted(job)) bar.value = job.progress.share;
      else bar.removeAttribute("value");
    },
  };
}

/** Asks the browser whether it may tell of the end of what takes long; gone where it was asked before. */
function noticeButton(): HTMLElement {
  const button: HTMLButtonElement = h("button", { class: "small", hidden: !("Notification" in window) || Notification.permission !== "default", onclick: () => {
    void Notification.requestPermission().then(() => void (button.hidden = true));
  } }, "Tell me at its end");
  return button;
}

/** A notice of the system's that a job has ended, where somebody looks elsewhere and wants one. */
function notify({ kind, state }: JobDocument): void {
  if (document.hidden && "Notification" in window && Notification.permission === "granted") new Notification(`${kindInWords(kind)}: ${state}`);
}

/** Chosen: before it, what is done tells little of what is left. */
const TELLING = 0.05;

/** How long a job will still take if it goes on as it did, by the server's own clock; empty where that is not known. */
export function leftInWords({ state, progress: { share }, created_at, started_at, updated_at }: JobDocument): string {
  // What waits for its members has not begun itself.
  const passed = (Date.parse(updated_at) - Date.parse(started_at ?? created_at)) / 1000;
  if (!(state === "running" || state === "waiting") || share < TELLING || share >= 1 || passed <= 0) return "";
  const left = (passed * (1 - share)) / share;
  return left < 60 ? "less than a minute left" : `about ${Math.round(left / 60)} min left`;
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
