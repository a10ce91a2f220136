/** What the words of the field that results use stand for, shown where one of them is pressed. */

import { fill, h, vary } from "./dom.ts";

export const METHODS: Record<string, string> = {
  MB: "marker-based: segments scaled by distances between markers",
  MB_lam: "marker-based, then lengths (l), knee axes (a) and selected marker coordinates (m) fitted to movement",
  MB_am: "marker-based, then knee axes (a) and all marker coordinates (m) fitted to movement",
  EB: "image-based (EOS, CT or MRI): segments and joint centres from the person's bones",
  EB_am: "image-based, then knee axes (a) and all marker coordinates (m) fitted to movement",
  MAP: "hips, lengths, axes, markers, skin and motion in one estimate, with what is ordinary in people",
};

const TERMS: Record<string, string> = {
  ...Object.fromEntries(Object.entries(METHODS).filter(([name]) => name !== "MAP")), // "map" is a word of notes, too
  "held-out": "recordings that no method was fitted to: the only ones that show how a model does on new data",
  "kinematic error": "the mean distance between each measured marker and the model's, over frames and markers",
  ordinary: "what is left between model and measurement of people as lively as this person: by skin, palpation, joints, masses and cameras",
  "left by it": "what is left where everything ordinary takes what it can",
};

const FOUND = new RegExp(`\\b(${Object.keys(TERMS).sort((a, b) => b.length - a.length).join("|")})\\b`, "i");

/** A text in which the first of its terms, and each method once, can be pressed. */
export function explained(text: string, known: ReadonlySet<string> = new Set()): (string | Node)[] {
  const match = FOUND.exec(text);
  if (match === null) return [text];
  const [word] = match;
  const [before, after] = [text.slice(0, match.index), text.slice(match.index + word.length)];
  return [before, known.has(word) ? word : term(word), ...explained(after, new Set([...known, word]))];
}

const meaning = h("div", { class: "meaning", popover: "auto", role: "status" });

function term(word: string): HTMLElement {
  const button: HTMLElement = h("button", { class: "term", type: "button", onclick: () => {
    if (!meaning.isConnected) document.body.append(meaning);
    fill(meaning, h("b", null, word), `: ${TERMS[word] ?? TERMS[word.toLowerCase()] ?? ""}.`);
    const { left, bottom } = button.getBoundingClientRect();
    vary(meaning, { "--left": `${Math.min(left, innerWidth - 300)}px`, "--top": `${bottom + 4}px` });
    meaning.showPopover();
  } }, word);
  return button;
}
