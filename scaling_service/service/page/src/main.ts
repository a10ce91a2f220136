/** The page begins here: one view for each place.
 *
 * | folder    | holds                                                                              |
 * |-----------|------------------------------------------------------------------------------------|
 * | `api`     | requests to the service, its keys, events and problems                              |
 * | `ui`      | elements, tables, choices, dialogs, colours, words; text never becomes HTML         |
 * | `charts`  | figures: descriptions for ECharts, their being saved                                |
 * | `space`   | the stage in space and what stands on it (three)                                    |
 * | `scene`   | what is played back: arrays in files, playback, the map of the error                |
 * | `intake`  | what is dropped: files, subject files, cohorts                                      |
 * | `imports` | the proof of a subject's files, and their correction                                |
 * | `views`   | one for each place: start, subjects, import, run, jobs, cohort                      |
 * | `results` | one for each kind of result                                                         |
 */

import { askWith } from "./api/key.ts";
import { asProblem, isAbort, Problem } from "./api/problem.ts";
import { parsed, type Place } from "./routes.ts";
import { shell } from "./shell.ts";
import { askForKeyOnScreen } from "./ui/dialog.ts";
import { fill } from "./ui/dom.ts";
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
      return (await import("./views/start.ts")).start;
    case "subjects":
      if (parts[1] === undefined) return (await import("./views/subjects.ts")).subjects;
      return parts[2] === "run" ? (await import("./views/run.ts")).run : (await import("./views/import.ts")).importing;
    case "jobs":
      return parts[1] === undefined ? (await import("./views/jobs.ts")).jobs : (await import("./views/job.ts")).job;
    case "cohort":
      return (await import("./views/cohort.ts")).cohort;
    default:
      return (await import("./views/nowhere.ts")).nowhere;
  }
}

async function go(): Promise<void> {
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  const place = parsed(location.hash);
  page.at(place.parts[0] ?? "");
  try {
    const view = await viewOf(place);
    if (signal.aborted) return;
    fill(page.main, notices());
    await view({ place, main: page.main, signal });
  } catch (error) {
    if (signal.aborted || isAbort(error)) return;
    if (!(error instanceof Problem)) console.error(error);
    page.main.append(problemBox(asProblem(error)));
  }
}

/** The window is called as its view, so that history, bookmarks and screen readers tell them apart. */
new MutationObserver(() => {
  const heading = page.main.querySelector("h1")?.textContent ?? "";
  document.title = heading === "" ? NAME : `${heading} · ${NAME}`;
}).observe(page.main, { childList: true });

addEventListener("hashchange", () => void go());
void go();
