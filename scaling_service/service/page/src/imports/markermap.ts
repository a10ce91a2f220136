/** Which label is which marker of the model: proposed, corrected by a click, saved for the laboratory. */

import { getJson, sendJson } from "../api/http.ts";
import type { MarkerMapDocument, MarkerProof, ProofDocument } from "../api/schema.ts";
import { folded } from "../ui/blocks.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { cell, table, type Cell, type Tone } from "../ui/table.ts";
import { number, percent } from "../ui/words.ts";
import type { Draft } from "./draft.ts";

export const laboratoryMap = (): Promise<MarkerMapDocument> => getJson("/v1/marker-map");

const SURE = 0.85;
const LIKELY = 0.5;

export class MarkerMap {
  readonly element = h("section");
  /** Called with the label to show in space. */
  show: (label: string) => void = () => undefined;
  private waiting: string | null = null;
  private readonly status = h("p", { role: "status", class: "status" });
  private readonly failed = h("div");
  private readonly labels: string[];
  /** Whose markers are shown. */
  private model: string;

  constructor(
    private proof: ProofDocument,
    private readonly draft: Draft,
    private readonly laboratory: MarkerMapDocument,
  ) {
    this.labels = [...new Set(proof.recordings.flatMap(({ labels }) => labels.map(({ label }) => label)))].sort();
    this.model = draft.chosenModel();
    this.draw();
  }

  /** The draft has changed: markers of another model are not known before the files were looked at again. */
  follow(): void {
    if (this.draft.chosenModel() === this.model) return;
    fill(this.element, h("h2", null, "Markers"), h("p", { class: "quiet" }, "Another model: its markers are being looked for …"));
  }

  /** The files were looked at again. */
  take(proof: ProofDocument): void {
    this.proof = proof;
    if (this.draft.chosenModel() === this.model) return; // nothing is redrawn under somebody's hands
    this.model = this.draft.chosenModel();
    this.draw();
  }

  /** A marker was clicked in space: it is taken for the one that waits, or its row is shown; whether none waited. */
  clicked(label: string | null): boolean {
    if (label === null) return true;
    if (this.waiting !== null) {
      this.draft.marker(this.waiting, label);
      const taken = this.waiting;
      this.waiting = null;
      this.draw();
      this.status.textContent = `${label} is taken for ${taken}.`;
      return false;
    }
    const found = this.proof.markers.find(({ marker }) => this.labelOf(marker) === label);
    this.status.textContent = found === undefined ? `${label} is no marker of the model.` : `${label} is ${found.marker}.`;
    this.element.querySelector(`[data-label="${CSS.escape(label)}"]`)?.scrollIntoView({ block: "nearest" });
    return true;
  }

  /** Label to the model's marker and segment, as proposed. */
  names(): Map<string, { marker: string; segment: string }> {
    const own = this.proof.markers.flatMap(({ marker, segment }): [string, { marker: string; segment: string }][] => {
      const label = this.labelOf(marker);
      return label === null ? [] : [[label, { marker, segment }]];
    });
    const further = this.proof.extra_markers.flatMap(({ label, segment }): [string, { marker: string; segment: string }][] =>
      segment === null ? [] : [[label, { marker: label, segment }]]);
    return new Map([...further, ...own]);
  }

  private labelOf(marker: string): string | null {
    const chosen = this.draft.document.markers ?? {};
    const found = this.proof.markers.find((one) => one.marker === marker)?.label ?? null;
    return chosen[marker] ?? (found !== null && Object.values(chosen).includes(found) ? null : found);
  }

  private draw(): void {
    const missing = this.proof.markers.filter(({ marker }) => this.labelOf(marker) === null).length;
    fill(
      this.element,
      h("h2", null, "Markers"),
      h("p", { class: "quiet" }, missing === 0
        ? "Every marker of the model has a label. To correct one, choose another label, or press Pick and click it in space."
        : `${missing} of ${this.proof.markers.length} markers of the model have no label. Choose one, or press Pick and click it in space; markers that are not needed may stay empty.`),
      this.status,
      table({
        caption: "Model markers and labels",
        name: "marker_map",
        columns: [{ title: "marker" }, { title: "label", words: true }, { title: "sure" }, { title: "why", words: true },
          { title: "segment", words: true }, { title: "recordings" }],
        rows: this.proof.markers.map((marker) => this.row(marker)),
        filter: true,
      }),
      this.proof.extra_markers.length > 0 && this.extras(),
      this.failed,
      h("div", { class: "actions" }, h("button", { onclick: () => void guarded(this.failed, () => this.save()) }, "Save these labels for the laboratory")),
    );
  }

  private row(found: MarkerProof): Cell[] {
    const { marker, segment, confidence, why, recordings } = found;
    const label = this.labelOf(marker);
    const corrected = label !== found.label;
    const sure = corrected ? 1 : label === null ? null : confidence;
    const tone: Tone = sure === null ? "unknown" : sure >= SURE ? "good" : sure >= LIKELY ? "fair" : "poor";
    return [
      { text: marker, node: h("span", label === null ? null : { "data-label": label }, marker) },
      { text: label ?? "", node: h("span", { class: "labelled" }, this.chooser(found, label), this.picker(marker)) },
      cell(percent(sure), sure, tone),
      cell(corrected ? "chosen here" : why),
      cell(segment),
      cell(`${recordings.length} of ${this.proof.recordings.length}`, recordings.length),
    ];
  }

  private chooser({ marker, others }: MarkerProof, label: string | null): HTMLElement {
    const likely = others.map((one) => one.label);
    const rest = this.labels.filter((one) => !likely.includes(one));
    const options = [{ value: "", text: "none" }, ...others.map((one) => ({ value: one.label, text: `${one.label} (${percent(one.confidence)})` })),
      ...rest.map((value) => ({ value, text: value }))];
    const field = select(`Label of ${marker}`, options, label ?? "", (value) => {
      this.draft.marker(marker, value === "" ? null : value);
      if (value !== "") this.show(value);
      this.draw();
    });
    field.querySelector("label")?.classList.add("sr");
    return field;
  }

  private picker(marker: string): HTMLElement {
    const waiting = this.waiting === marker;
    return h("button", { class: "small", "aria-pressed": String(waiting), "aria-label": `Pick ${marker} in space`, onclick: () => {
      this.waiting = waiting ? null : marker;
      this.draw();
      this.status.textContent = this.waiting === null ? "" : `Click the marker that is ${marker}.`;
    } }, "Pick");
  }

  /** Labels that are no markers of the model may be used on the segment that they move with. */
  private extras(): HTMLElement {
    const segments = [...new Set(this.proof.markers.map(({ segment }) => segment))];
    const rows = this.proof.extra_markers.map(({ label, segment, confidence, why }): Cell[] => {
      const options = [{ value: "", text: "not used" }, ...segments.map((value) => ({ value, text: value }))];
      const field = select(`Segment of ${label}`, options, this.draft.document.extra_markers?.[label] ?? "", (value) =>
        this.draft.extra(label, value === "" ? null : value));
      field.querySelector("label")?.classList.add("sr");
      return [cell(label), cell(segment ?? "–"), cell(number(confidence), confidence), cell(why), { text: "", node: field }];
    });
    const found = this.proof.extra_markers.filter(({ segment }) => segment !== null);
    const all = h("button", { onclick: () => {
      for (const { label, segment } of found) this.draft.extra(label, segment);
      this.draw();
    } }, `Use the ${found.length} that sit on a segment`);
    return folded(`Further labels (${rows.length})`, found.length > 0 && h("div", { class: "actions" }, all), table({
      caption: "Further labels",
      name: "further_labels",
      columns: [{ title: "label" }, { title: "sits on", words: true }, { title: "sure" }, { title: "why", words: true }, { title: "use on", words: true }],
      rows,
      filter: true,
      note: "Further tracking markers are placed on their segment from the static trial.",
    }));
  }

  /** Labels without the name of the subject before them, for the next subjects of this laboratory. */
  private async save(): Promise<void> {
    const found = this.proof.markers.flatMap(({ marker }) => {
      const label = this.labelOf(marker);
      return label === null ? [] : [[label.replace(/^[^:]*:/, ""), marker]];
    });
    const labels = { ...this.laboratory.labels, ...(Object.fromEntries(found) as Record<string, string>) };
    await sendJson("/v1/marker-map", { labels }, "PUT");
    this.status.textContent = `${found.length} labels are saved for the laboratory.`;
  }
}
