/** The page begins here: one view for each place.
 *
 * | folder    | holds                                                                              |
 * |-----------|------------------------------------------------------------------------------------|
 * | `api`     | requests to the service, its keys, events and problems                              |
 * | `ui`      | elements, tables, choices, dialogs, colours, words; text never becomes HTML         |
 * | `charts`  | figures: descriptions for plotly, their being saved                                 |
 * | `space`   | the stage in space and what stands on it (three)                                    |
 * | `scene`   | what is played back: arrays in files, playback, the map of the error                |
 * | `intake`  | what is dropped: files, subject files, cohorts                                      |
 * | `imports` | the proof of a subject's files, and their correction                                |
 * | `views`   | one for each place: start, subjects, import, run, jobs, cohort                      |
 * | `results` | one for each kind of result                                                         |
 * | `report`  | another beginning: the results alone, within a file that holds what they show       |
 */

import { part } from "./api/connection.ts";
import { askWith } from "./api/key.ts";
import { asProblem, isAbort, Problem } from "./api/problem.ts";
import { parsed, type Place } from "./routes.ts";
import { shell } from "./shell.ts";
import { askForKeyOnScreen } from "./ui/dialog.ts";
import { fill, h } from "./ui/dom.ts";
import { notices } from "./ui/flash.ts";
import { problemBox } from "./ui/problem.ts";
import { apply } from "./ui/theme.ts";
import type { View } from "./views/view.ts";

const NAME = "scaling-service";

apply();
askWith(askForKeyOnScreen);
const page = shell();
let leaving = new AbortController();

/** The view of a place; each is loaded when it is first needed. */
async function viewOf({ parts }: Place): Promise<View> {
  switch (parts[0]) {
    case undefined:
      return (await part(() => import("./views/start.ts"))).start;
    case "subjects":
      if (parts[1] === undefined) return (await part(() => import("./views/subjects.ts"))).subjects;
      if (parts[2] === "report") return (await part(() => import("./views/person.ts"))).person;
      return parts[2] === "run" ? (await part(() => import("./views/run.ts"))).run : (await part(() => import("./views/import.ts"))).importing;
    case "jobs":
      return parts[1] === undefined ? (await part(() => import("./views/jobs.ts"))).jobs : (await part(() => import("./views/job.ts"))).job;
    case "cohort":
      return (await part(() => import("./views/cohort.ts"))).cohort;
    default:
      return (await part(() => import("./views/nowhere.ts"))).nowhere;
  }
}

async function go(): Promise<void> {
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  const place = parsed(location.hash);
  page.at(place.parts[0] ?? "");
  fill(page.trouble);
  try {
    const view = await viewOf(place);
    if (signal.aborted) return;
    fill(page.main, notices());
    await view({ place, main: page.main, signal });
  } catch (error) {
    if (!signal.aborted) tell(error, page.main);
  }
}

function tell(error: unknown, place: HTMLElement): void {
  if (isAbort(error)) return;
  if (!(error instanceof Problem)) console.error(error);
  if (place === page.main && place.querySelector("h1") === null) place.append(h("h1", null, "This cannot be shown"));
  place.append(problemBox(asProblem(error)));
}

/** What fails beside a view, such as a picture that comes later, is shown like everything else. */
addEventListener("unhandledrejection", (event) => {
  event.preventDefault();
  fill(page.trouble);
  tell(event.reason, page.trouble);
});

/** The window is called as its view, so that history, bookmarks and screen readers tell them apart. */
new MutationObserver(() => {
  const heading = page.main.querySelector("h1")?.textContent ?? "";
  document.title = heading === "" ? NAME : `${heading} · ${NAME}`;
}).observe(page.main, { childList: true });

addEventListener("hashchange", () => void go());
void go();
