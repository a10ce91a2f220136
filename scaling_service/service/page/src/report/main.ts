/** A report begins here: the views of one result, which stands in the page itself with all that they show.
 *
 * Until the view is there, and where it cannot be, what Python wrote for readers without JavaScript is seen.
 */

import { answerWith } from "../api/http.ts";
import { asProblem, isAbort, Problem } from "../api/problem.ts";
import { parsed } from "../routes.ts";
import { viewOf } from "../results/views.ts";
import { themeButton } from "../shell.ts";
import { h } from "../ui/dom.ts";
import { problemBox } from "../ui/problem.ts";
import { saveText } from "../ui/save.ts";
import { apply } from "../ui/theme.ts";
import { answer, besides, held, OWN } from "./answers.ts";

const report = held();
const summary = document.querySelector("main");
let leaving = new AbortController();
let shown = summary;

async function go(): Promise<void> {
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  const main = h("main", { id: "main", tabindex: -1 },
    h("h1", null, report.title), report.subtitle !== "" && h("p", { class: "quiet" }, report.subtitle));
  const given = parsed(location.hash);
  const place = given.parts[1] === OWN ? given : { parts: ["jobs", OWN], query: new URLSearchParams() };
  const view = await viewOf(report.kind);
  shown?.replaceWith(main); // before it is filled: figures are drawn as wide as their place
  shown = main;
  await view({
    job: { id: OWN, kind: report.kind }, request: {}, main, place, signal,
    takeAway: (_, where) => void where.append(besides(report, (name, text) => saveText(name, text, "application/json"))),
  });
}

function tell(error: unknown): void {
  if (isAbort(error)) return;
  if (!(error instanceof Problem)) console.error(error);
  shown?.append(problemBox(asProblem(error)));
}

/** Show a place; the summary where its view fails. */
function show(): void {
  void go().catch((error: unknown) => {
    tell(error);
    if (!isAbort(error) && shown !== summary) shown?.append(...(summary?.childNodes ?? []));
  });
}

addEventListener("unhandledrejection", (event) => {
  event.preventDefault();
  tell(event.reason);
});
addEventListener("hashchange", show);

answerWith((path, asked) => answer(report, path, asked));
apply();
document.querySelector("header")?.append(themeButton());
// What is there already is painted first.
requestAnimationFrame(() => setTimeout(show));
