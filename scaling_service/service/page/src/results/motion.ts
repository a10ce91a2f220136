/** How a model follows recordings: errors trial by trial, and what the markers do not tell. */

import { getResult } from "../api/jobs.ts";
import type { MotionDocument } from "../api/schema.ts";
import { h } from "../ui/dom.ts";
import { cell, table } from "../ui/table.ts";
import { few, number, words } from "../ui/words.ts";
import { bands } from "./bands.ts";
import { parts, type ResultView } from "./result.ts";

export const motion: ResultView = async (found) => {
  const document = await getResult<MotionDocument>(found.job.id, found.signal);
  await parts("Parts of the motion", found, [
    { name: "errors", title: "Errors", show: (place) => place.append(...errors(document)) },
    { name: "angles", title: "Angles and their bands", show: (place) => bands(document, found, place) },
  ]);
};

function errors({ model, warnings, trials }: MotionDocument): HTMLElement[] {
  const rows = Object.entries(trials).map(([name, trial]) => {
    const { mean, rms, max } = trial.kinematic_error_mm;
    const lost = [...trial.not_determined, ...Object.keys(trial.frames_not_determined).map((one) => `${one} at times`)];
    return [cell(name), cell(String(trial.frames), trial.frames), ...[mean, rms, max].map((value) => cell(number(value), value)),
      cell(few(lost.map(words)) || "nothing")];
  });
  const turned = [...new Set(Object.values(trials).flatMap(({ rotation_error_deg: turns = {} }) => Object.keys(turns)))];
  return [
    ...warnings.map((warning) => h("p", { class: "note" }, warning)),
    table({
      caption: `Kinematic error with ${model}`,
      name: "motion",
      columns: ["recording", "frames", "mean, mm", "RMS, mm", "largest, mm", "not determined"].map((title) => ({ title })),
      rows,
      note: "Standard deviations of all coordinates in all frames: under “Angles and their bands”, and in the files that end in _ik_sd.mot.",
    }),
    ...(turned.length === 0 ? [] : [table({
      caption: "Measured rotations and the model's, mounting included: RMS angle, deg",
      name: "rotations",
      columns: ["rotation", ...Object.keys(trials)].map((title) => ({ title })),
      rows: turned.map((name) => [cell(name), ...Object.values(trials).map(({ rotation_error_deg: turns = {} }) => {
        const value = turns[name] ?? null;
        return cell(number(value), value);
      })]),
    })]),
  ];
}
