/** What is known of the person and the marker set before anything is computed, in words. */

import type { MarkerSetProof, ProofDocument, SizesProof } from "../api/schema.ts";
import { h } from "../ui/dom.ts";
import { sentence } from "../ui/problem.ts";
import { number } from "../ui/words.ts";

export function facts({ marker_set, consequences, sizes, model, model_why }: ProofDocument): HTMLElement {
  const lines = [
    ...(model_why === null ? [] : [`${model} is proposed: ${model_why}.`]),
    ...(sizes === null ? [] : measured(sizes)),
    marker_set === null ? "No marker set is known that has these labels; they count by their names alone." : setInWords(marker_set),
    ...consequences.map(sentence),
  ];
  return h("ul", { class: "quiet" }, ...lines.map((text) => h("li", null, text)));
}

function setInWords({ title, additions, share, lacks }: MarkerSetProof): string {
  const missing = lacks.length === 0 ? "" : `, not ${lacks.join(", ")}`;
  return `Marker set: ${[title, ...additions].join(" with ")}; ${number(100 * share, 0)} % of its labels are there${missing}.`;
}

function measured({ sizes_mm, source }: SizesProof): string[] {
  const sizes = Object.entries(sizes_mm).map(([name, value]) => `${name.replaceAll("_", " ")} ${number(value, 0)} mm`);
  return sizes.length === 0 ? [] : [`Measured by hand: ${sizes.join(", ")} (from ${source.join(", ")}).`];
}
