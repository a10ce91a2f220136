/** Problems on screen: where, what, and what to do. */

import { asProblem, isAbort, type ProblemDetails } from "../api/problem.ts";
import type { CorrectionEntry, ProblemEntry } from "../api/schema.ts";
import { fill, h } from "./dom.ts";
import { correctionInWords, plural } from "./words.ts";

export type Severity = ProblemEntry["severity"];

interface Help {
  correct: (file: string, correction: CorrectionEntry) => void;
  /** Lead to where the field of a document is given. */
  give: (field: string) => void;
}

const GIVEN: Record<string, string> = { subject: "height", "trials.static": "static", forces: "forces" };

/** Where on the page stands what a subject file calls so. */
const PLACES: Record<string, string> = {
  "trials.evaluation": "Files as “evaluation: held out”", "trials.static": "Files as “static”", markers: "“2 Markers”", extra_markers: "“Further labels” of “2 Markers”",
};

const onPage = (remedy: string): string => remedy.replace(/`([a-z_.]+):?`/g, (written, name: string) => PLACES[name] ?? written);

/** Errors first, then what is to be looked at, each with what solves it; what asks for nothing is folded. */
export function problemList(all: readonly ProblemEntry[], { correct, give }: Help): HTMLElement {
  const box = (one: ProblemEntry): HTMLElement => {
    const field = GIVEN[one.field ?? ""];
    // Where a button does it, nobody has to know what is written into the subject file.
    const element = problemBox({ ...one, remedy: field === undefined && one.corrections.length === 0 && one.remedy != null ? onPage(one.remedy) : null }, one.severity);
    const buttons = one.corrections.map((found) => {
      return h("button", { onclick: () => correct(found.file, found) }, sentence(`${correctionInWords(found)} in ${found.file}`).replace(/\.$/, ""));
    });
    if (field !== undefined) buttons.push(h("button", { onclick: () => give(field) }, "Give it"));
    if (buttons.length > 0) element.append(h("div", { class: "actions" }, ...buttons));
    return element;
  };
  const of = (severity: Severity): ProblemEntry[] => all.filter((one) => one.severity === severity);
  const [warnings, notes] = [of("warning"), of("note")];
  return h("div", { class: "problems" }, ...of("error").map(box),
    warnings.length > 0 && h("details", { open: warnings.some(({ corrections }) => corrections.length > 0) || warnings.length < 3 },
      h("summary", null, `${plural(warnings.length, "thing")} to look at`), h("div", { class: "boxes" }, ...warnings.map(box))),
    notes.length > 0 && h("details", null, h("summary", null, plural(notes.length, "note")), h("div", { class: "boxes" }, ...notes.map(box))));
}

export function problemBox(problem: ProblemDetails, severity: Severity = "error"): HTMLElement {
  const where = [problem.file, problem.field === "subject" ? "" : problem.field].filter((part) => part !== null && part !== undefined && part !== "");
  return h(
    "div",
    { class: `problem ${severity}`, role: severity === "error" ? "alert" : null },
    where.length > 0 && h("p", { class: "where" }, h("code", null, where.join(", "))),
    h("p", { class: "what" }, sentence(problem.problem)),
    problem.remedy && h("p", { class: "remedy" }, h("b", null, "What to do: "), sentence(problem.remedy)),
  );
}

/** A sentence with its capital and its stop. */
export function sentence(text: string): string {
  const first = text.split(/[\s,;:]/, 1)[0] ?? "";
  // Names of files, markers and fields stay as they are written.
  const begun = /^[a-z][a-z'’-]*$/.test(first) ? text.charAt(0).toUpperCase() + text.slice(1) : text;
  return /[.!?…]$/.test(begun) ? begun : `${begun}.`;
}

/** Do something and show in `place` what goes wrong; what was shown there before goes. */
export async function guarded(place: Element, work: () => Promise<unknown>): Promise<void> {
  fill(place);
  try {
    await work();
  } catch (error) {
    if (isAbort(error)) return;
    if (asProblem(error).message.startsWith("The page has a defect")) console.error(error);
    fill(place, problemBox(asProblem(error)));
  }
}
