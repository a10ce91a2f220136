/** How closely each method's model follows the markers: by trial and by marker. */

import type { ComparisonDocument, MethodResult } from "../api/schema.ts";
import { barsHeight, drawBars } from "../charts/bars.ts";
import { figure } from "../charts/figure.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { styleOf } from "../ui/palette.ts";
import { cell, table } from "../ui/table.ts";
import { number } from "../ui/words.ts";
import { union } from "./result.ts";
import type { Finished } from "./result.ts";
import { methodColumns } from "./verdict.ts";

export function errors(document: ComparisonDocument, { signal }: Finished, place: HTMLElement): void {
  const methods = Object.values(document.methods);
  const trials = union(methods.map((method) => method.kinematic_error_mm));
  place.append(byTrial(methods, trials));
  const drawing = h("div");
  const state = { trial: trials.at(-1) ?? "", method: document.verdict?.method ?? methods[0]?.method ?? "" };
  const show = (): void => fill(drawing, byMarker(document, state.trial, state.method, signal));
  const options = (names: string[]): { value: string; text: string }[] => names.map((value) => ({ value, text: value }));
  place.append(
    h("h2", null, "By marker"),
    h("div", { class: "bar" },
      select("trial", options(trials), state.trial, (value) => { state.trial = value; show(); }),
      select("method", options(methods.map(({ method }) => method)), state.method, (value) => { state.method = value; show(); })),
    drawing,
    markerTable(methods, trials),
  );
  show();
}

function byTrial(methods: MethodResult[], trials: string[]): HTMLElement {
  const rows = trials.map((trial) => {
    const role = methods.find((method) => trial in method.kinematic_error_mm)?.kinematic_error_mm[trial]?.role;
    return [
      cell(trial),
      cell(role === "evaluation" ? "held out" : "fitted"),
      ...methods.map(({ kinematic_error_mm }) => {
        const error = kinematic_error_mm[trial];
        return error === undefined ? cell("–", null) : { ...cell(`${number(error.mean)} ± ${number(error.sd)}`, error.mean),
          hint: `RMS ${number(error.rms)}, at most ${number(error.max)} mm over ${error.frames} frames` };
      }),
    ];
  });
  return table({
    caption: "Kinematic error, mm (mean ± SD over frames)",
    name: "kinematic_error_mm",
    columns: [{ title: "trial" }, { title: "used" }, ...methodColumns(methods.map(({ method }) => method))],
    rows,
    note: "Mean distance between measured and model markers. OpenSim's best practices ask for an RMS below 20 mm and at most 40 mm: necessary, not sufficient.",
  });
}

function byMarker(document: ComparisonDocument, trial: string, method: string, signal: AbortSignal): HTMLElement {
  const found = document.methods[method]?.kinematic_error_mm[trial]?.per_marker ?? {};
  const colour = styleOf(method).colour;
  const bars = Object.entries(found).sort((a, b) => b[1] - a[1]).map(([name, value]) => ({ name, value, colour }));
  return figure({
    title: `${method} in ${trial}: mean distance of each marker`,
    name: `errors_${trial}_${method}`,
    alt: `Bars of ${bars.length} markers; the largest: ${bars.slice(0, 3).map((bar) => `${bar.name} ${number(bar.value)} mm`).join(", ")}.`,
    height: barsHeight(bars.length),
    drawing: (ink) => drawBars(ink, { bars, axis: "mean distance, mm", unit: "mm" }),
    rows: () => [["marker", "mean_mm"], ...bars.map((bar) => [bar.name, bar.value])],
  }, signal).element;
}

function markerTable(methods: MethodResult[], trials: string[]): HTMLElement {
  const of = (method: MethodResult, trial: string): Record<string, number> => method.kinematic_error_mm[trial]?.per_marker ?? {};
  const markers = union(methods.flatMap((method) => trials.map((trial) => of(method, trial))));
  const rows = trials.flatMap((trial) =>
    markers.filter((marker) => methods.some((method) => marker in of(method, trial))).map((marker) => [
      cell(marker),
      cell(trial),
      ...methods.map((method) => cell(number(of(method, trial)[marker]), of(method, trial)[marker] ?? null)),
    ]),
  );
  return table({
    caption: "Mean distance of each marker in each trial, mm",
    name: "errors_by_marker_mm",
    columns: [{ title: "marker" }, { title: "trial" }, ...methodColumns(methods.map(({ method }) => method))],
    rows,
    filter: true,
  });
}
