/** Motion that markers and ground forces agree on: what it costs at the markers, and what it gains at the forces. */

import { getResult } from "../api/jobs.ts";
import type { ConsistentDocument, GroundWrench } from "../api/schema.ts";
import { bullets, callout, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { figures, number, signed, words } from "../ui/words.ts";
import { parts, type ResultView } from "./result.ts";
import { wrenches } from "./wrenches.ts";

const WAYS = ["classical", "predicted", "consistent"] as const;

export const consistent: ResultView = async (found) => {
  const document = await getResult<ConsistentDocument>(found.job.id, found.signal);
  await parts("Parts of the result", found, [
    { name: "agreement", title: "Forces and markers", show: async (place) => place.append(...forces(document), await wrenches(found.job.id, found.signal)) },
    { name: "model", title: "The model found", show: (place) => place.append(lengths(document), inertia(document)) },
  ]);
};

function forces({ headline, tone, trials, outer_iterations, converged, warnings }: ConsistentDocument): HTMLElement[] {
  const rows = Object.entries(trials).flatMap(([name, trial]) => [
    ...(Object.keys(trial.ground_wrench_rmse.classical) as (keyof GroundWrench)[])
      .filter((component) => WAYS.some((way) => trial.ground_wrench_rmse[way][component] !== null))
      .map((component) => [cell(name), cell(trial.held_out ? "held out" : "fitted"), cell(`ground wrench, ${component.replace("_", ", ")}`),
        ...WAYS.map((way) => cell(number(trial.ground_wrench_rmse[way][component]), trial.ground_wrench_rmse[way][component] ?? null))]),
    [cell(name), cell(trial.held_out ? "held out" : "fitted"), cell("markers, mm"), ...WAYS.map((way) => cell(number(trial.marker_rms_mm[way]), trial.marker_rms_mm[way]))],
  ]);
  return [
    callout(sentence(headline ?? ""), tone ?? "plain", h("p", null, `${outer_iterations} loops of motion, geometry and inertia${converged ? "." : ", and they had not settled."}`)),
    table({
      caption: "RMS error of the ground wrench and of the markers",
      name: "consistent",
      columns: ["trial", "used", "of", ...WAYS].map((title) => ({ title })),
      rows,
      filter: true,
      note: "Classical: inverse kinematics with the model of the start. Predicted: the same with the model found, from markers alone. Consistent: markers and forces followed together.",
    }),
    warnings.length > 0 ? folded("Notes", bullets(warnings)) : h("span"),
  ];
}

function lengths({ lengths_mm, lengths_before_mm }: ConsistentDocument): HTMLElement {
  return table({
    caption: "Segment lengths, mm",
    name: "consistent_lengths_mm",
    columns: ["segment", "before", "found", "difference"].map((title) => ({ title })),
    rows: Object.entries(lengths_mm).map(([name, value]) => {
      const before = lengths_before_mm[name];
      const gap = before === undefined ? null : value - before;
      return [cell(words(name)), cell(number(before), before ?? null), cell(number(value), value), cell(signed(gap), gap)];
    }),
  });
}

function inertia({ inertial }: ConsistentDocument): HTMLElement {
  return table({
    caption: "Inertia, SI units",
    name: "consistent_inertia",
    columns: ["segment", "quantity", "before", "after", "SD", "moved, SD of the prior", "told by the recordings"].map((title) => ({ title })),
    rows: inertial.map((one) => [cell(words(one.segment)), cell(one.quantity), cell(figures(one.before), one.before), cell(figures(one.after), one.after),
      cell(figures(one.sd), one.sd), cell(figures(one.moved), one.moved), cell(one.identifiable ? "yes" : "no")]),
    filter: true,
  });
}
