/** Problems on screen: where, what, and what to do. */

import { asProblem, isAbort, type Told } from "../api/problem.ts";
import { fill, h } from "./dom.ts";

export type Severity = "error" | "warning";

export function problemBox(told: Told, severity: Severity = "error"): HTMLElement {
  const where = [told.file, told.field].filter((part) => part !== null && part !== undefined && part !== "");
  return h(
    "div",
    { class: `problem ${severity}`, role: severity === "error" ? "alert" : null },
    where.length > 0 && h("p", { class: "where" }, h("code", null, where.join(", "))),
    h("p", { class: "what" }, sentence(told.problem)),
    told.remedy && h("p", { class: "remedy" }, h("b", null, "What to do: "), sentence(told.remedy)),
  );
}

/** A sentence with its capital and its stop. */
export function sentence(text: string): string {
  const begun = text.charAt(0).toUpperCase() + text.slice(1);
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
