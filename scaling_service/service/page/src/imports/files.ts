/** What each file is, and what it is for. */

import type { FileRole, ProofDocument } from "../api/schema.ts";
import { removeFile } from "../api/subjects.ts";
import { again } from "../routes.ts";
import { select, type Option } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { guarded, sentence } from "../ui/problem.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import type { Draft } from "./draft.ts";

const KINDS: Record<FileRole["kind"], string> = {
  recording: "recording", forces: "forces", model: "model", mesh: "bone", segmentation: "bones, segmented", image_markers: "markers on the image",
  setup: "OpenSim set-up", subject: "subject file", other: "other",
};

export function fileTable(proof: ProofDocument, draft: Draft, bones: readonly string[]): HTMLElement {
  const failed = h("div");
  const recordings = proof.files.filter(({ kind }) => kind === "recording").map(({ name }) => name);
  const rows = proof.files.map((file): Cell[] => [
    cell(file.name),
    { text: draft.roleOf(file.name), node: chooser(file, draft, optionsOf(file.kind, recordings, bones)) },
    cell(KINDS[file.kind]),
    file.problem === null
      ? cell(file.why)
      : { text: file.problem.problem, tone: "poor", node: h("span", null, `${sentence(file.problem.problem)} ${file.problem.remedy ?? ""}`) },
    { text: "", node: removal(proof.subject, file.name, failed) },
  ]);
  return h(
    "div",
    { "data-give": "static evaluation bones forces recordings" },
    failed,
    table({
      caption: "What each file is for",
      name: "files",
      columns: [{ title: "file" }, { title: "used as", words: true }, { title: "is", words: true }, { title: "why", words: true }, { title: "" }],
      rows,
      note: "Calibration: the optimisation takes its frames from here. Evaluation: never used to fit, so its error is honest.",
    }),
  );
}

function optionsOf(kind: FileRole["kind"], recordings: readonly string[], bones: readonly string[]): Option[] {
  const none = { value: "", text: "not used" };
  const plain = (value: string, text = value): Option => ({ value, text });
  switch (kind) {
    case "recording":
      return [none, plain("static", "static: standing still"), plain("calibration"), plain("evaluation", "evaluation: held out"),
        plain("static+calibration", "static and calibration")];
    case "forces":
      return [none, ...recordings.map((name) => plain(`forces.${name}`, `forces of ${name}`))];
    case "mesh":
      return [none, ...bones.map((bone) => plain(`bones.${bone}`, bone))];
    case "segmentation":
      return [none, plain("bones.segmentation", "bones: segmentation")];
    case "model":
      return [none, plain("model"), plain("marker_set", "marker set"), plain("scale_setup", "scale set-up")];
    case "setup":
      return [none, plain("marker_set", "marker set"), plain("scale_setup", "scale set-up")];
    case "image_markers":
      return [none, plain("image_markers", "markers on the image")];
    default:
      return [none];
  }
}

function chooser({ name }: FileRole, draft: Draft, options: Option[]): HTMLElement {
  if (options.length === 1) return h("span", { class: "quiet" }, "nothing to choose");
  const present = draft.roleOf(name);
  const all = options.some(({ value }) => value === present) ? options : [...options, { value: present, text: present }];
  const field = select(`Use of ${name}`, all, present, (role) => draft.assign(name, role));
  field.querySelector("label")?.classList.add("sr");
  return field;
}

function removal(subject: string, name: string, failed: HTMLElement): HTMLElement {
  const remove = async (): Promise<void> => {
    await removeFile(subject, name);
    again();
  };
  return h("button", { class: "small", "aria-label": `Remove ${name}`, onclick: () => void guarded(failed, remove) }, "Remove");
}
