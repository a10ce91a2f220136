/** The search for a missing effect as a story: where, what, with and without it, on unseen data. */

import { part } from "../api/connection.ts";
import { getResult } from "../api/jobs.ts";
import { vocabulary } from "../api/vocabulary.ts";
import type { DiscoveryDocument } from "../api/schema.ts";
import { bullets, callout, folded } from "../ui/blocks.ts";
import { h, vary } from "../ui/dom.ts";
import { few, shareInWords } from "../ui/words.ts";
import { parts, type Finished, type ResultView } from "./result.ts";
import { unseen } from "./unseen.ts";
import { places, what } from "./what.ts";
import { where } from "./where.ts";

const MOST = 3; // lines of the story that are open: as many as are read in a minute

export const discovery: ResultView = async (found) => {
  const document = await getResult<DiscoveryDocument>(found.job.id, found.signal);
  const { hidden_in_example } = await vocabulary();
  const inReport = !("subject" in found.request); // whose head says already how the search went
  const first = (found.place.parts[2] ?? "where") === "where";
  found.main.append(...(first ? verdict(document, inReport || isExample(document) ? hidden_in_example : [], inReport) : [summary(document)]));
  await parts("Steps of the story", found, [
    { name: "where", title: "1. Where", show: (place) => where(document, found.signal, place) },
    { name: "what", title: "2. What", show: (place) => what(document, found.signal, place) },
    { name: "space", title: "3. With and without", handled: true, show: (place) => withAndWithout(found, document.markers_used, place) },
    { name: "unseen", title: "4. On unseen data", show: (place) => unseen(document, found.signal, place) },
  ]);
};

async function withAndWithout(found: Finished, used: Record<string, string[]>, place: HTMLElement): Promise<void> {
  place.append(h("p", null, "The model as given, and with what was named, in the same recording. The maps show what is left over, without and with it, in the same colours."));
  await (await part(() => import("./space.ts"))).space(found, place, used, ["with what was named", "as given"], true);
}

/** The service knows its example by the same: its name, and that it brings markers on images. */
const isExample = ({ subject, input_hashes }: DiscoveryDocument): boolean =>
  /^example(_\d+)?$/.test(subject) && "image_markers.csv" in input_hashes;

/** Sizes that are doubtful. */
const cautionsOf = ({ effects }: DiscoveryDocument): string[] =>
  effects.flatMap(({ belief }) => belief?.cautions ?? []);

const summary = (document: DiscoveryDocument, ...more: (HTMLElement | false)[]): HTMLElement =>
  callout(document.headline, document.tone ?? "plain", ...more);

/** All that was found; steps after the first show only the summary above their own pictures. */
function verdict(document: DiscoveryDocument, hidden: readonly string[], inReport: boolean): HTMLElement[] {
  const { effects, unexplained, notes } = document;
  const cautions = cautionsOf(document);
  const lines = Math.min(MOST, effects.filter(({ carries }) => carries).length);
  const more = few(unexplained.slice(MOST).flatMap((one) => places(one.where)));
  return [
    h("p", { class: "quiet" }, inReport ? "" : subtitle(document)),
    summary(
      document,
      told(effects.slice(0, lines), 1),
      effects.length > lines && folded(lines > 0 ? `${effects.length - lines} more` : `${effects.length} named, which take next to nothing off the gap`, told(effects.slice(lines), lines + 1)),
      ...unexplained.slice(0, MOST).map(({ where, law }) => h("p", null, `Beyond what is ordinary, and no effect that is known${at(where)}: ${law}.`)),
      more !== "" && h("p", null, `And at ${more}.`),
    ),
    cautions.length > 0 ? callout("Sizes to doubt", "fair", bullets(cautions)) : h("span"),
    hidden.length > 0 ? folded("What had been hidden in this virtual person", bullets(hidden)) : h("span"),
    bones(document),
    notes.length > 0 ? folded("What was not tried, or cannot be decided", bullets(notes)) : h("span"),
  ];
}

const at = (where: readonly string[]): string => (places(where).length === 0 ? "" : `, at ${few(places(where))}`);

/** A line for each effect, counted from a number on. */
export const told = (effects: DiscoveryDocument["effects"], start: number): HTMLElement | false =>
  effects.length > 0 && h("ol", { start: String(start) }, ...effects.map(({ name, advice, belief, evidence }) => h("li", null, name, share(evidence.gain_held_out), advice !== "" && h("div", null, advice), belief != null && h("div", { class: "quiet" }, belief.summary))));

/** How much of what did not fit an effect it takes off, as a bar. */
function share(gain: number | null): HTMLElement | false {
  if (gain === null || gain <= 0) return false;
  const bar = vary(h("i", { "aria-hidden": "true" }), { "--share": String(Math.min(gain, 1)) });
  return h("div", { class: "share" }, bar, `takes ${shareInWords(gain)} off the squared gap of what did not fit it`);
}

/** What is known of the bones beside the effects; `ik` takes it from the model. */
function bones({ bones: known }: DiscoveryDocument): HTMLElement {
  const lines = known?.sentences ?? [];
  return lines.length > 0 ? folded("What is known of the bones", bullets(lines)) : h("span");
}

function subtitle({ start, fitted_trials, held_out_trials }: DiscoveryDocument): string {
  const held = held_out_trials.length === 0 ? "" : `; held out: ${held_out_trials.join(", ")}`;
  return `Model ${start === "none" ? "as given" : `scaled by ${start}`}. Fitted: ${fitted_trials.join(", ")}${held}`;
}
