/** Residual forces and moments over time, against the limit on their peaks. */

import { figure } from "../charts/figure.ts";
import { drawLines, type Curve } from "../charts/lines.ts";
import { getJson } from "../api/http.ts";
import { filePath } from "../api/jobs.ts";
import { Problem } from "../api/problem.ts";
import type { DynamicsDocument, ResidualScene, TrialDynamicsDocument } from "../api/schema.ts";
import { Frames } from "../scene/frames.ts";
import { pathIn } from "../scene/scene.ts";
import { h } from "../ui/dom.ts";
import type { Style } from "../ui/palette.ts";
import { number } from "../ui/words.ts";

const AXES: [string, Style][] = [
  ["x, forward", { colour: "#D55E00", dash: "solid" }],
  ["y, up", { colour: "#009E73", dash: "dash" }],
  ["z, right", { colour: "#0072B2", dash: "dot" }],
];
const PARTS = [
  { what: "force", unit: "N", first: 0 },
  { what: "moment", unit: "N m", first: 3 },
] as const;

export async function residualCurves(document: DynamicsDocument, job: string, signal: AbortSignal): Promise<HTMLElement> {
  const found = await getJson<ResidualScene>(filePath(job, "scene/residuals.json"), signal).catch((error: unknown) => {
    if (error instanceof Problem && error.status === 404) return null; // made by an older version
    throw error;
  });
  if (found === null) return h("p", { class: "quiet" }, "The residuals over time are not kept with this job; ask for the same again to see them.");
  const drawn = Object.entries(found.trials).map(async ([name, { start_s, rate_hz, residual }]) => {
    const { values, step } = await new Frames(residual, pathIn(job), signal, () => undefined).whole();
    const x = Float64Array.from({ length: values.length / 6 }, (_, k) => start_s + (k * step) / rate_hz);
    return PARTS.map((part) => drawing(name, part, x, values, document.trials[name], signal));
  });
  return h("div", { class: "grid" }, ...(await Promise.all(drawn)).flat());
}

function drawing(
  name: string,
  { what, unit, first }: (typeof PARTS)[number],
  x: Float64Array,
  values: Float32Array,
  trial: TrialDynamicsDocument | undefined,
  signal: AbortSignal,
): HTMLElement {
  const curves = AXES.map(([axis, style], k): Curve => ({ name: axis, style, y: Float32Array.from(x, (_, row) => values[6 * row + first + k] ?? NaN) }));
  const limit = trial?.gates.find((gate) => gate.name === `peak ${what}` && gate.source.startsWith("Hicks"))?.limit;
  const levels = limit === undefined ? [] : [{ y: limit, name: "limit" }, { y: -limit, name: "" }];
  const peaks = curves.map((one) => `${one.name} ${number(peak(one.y), 0)}`).join("; ");
  return figure({
    title: `${name}: residual ${what}, ${unit}`,
    name: `residual_${what}_${name}`,
    alt: `Residual ${what} of ${name} over time. Largest: ${peaks} ${unit}.${limit === undefined ? "" : ` Limit on the peak: ${number(limit, 0)}.`}`,
    zoom: true,
    height: 240,
    drawing: (ink) => drawLines(ink, { x, curves, unit, levels, xAxis: { name: "time, s" }, yAxis: { name: unit } }),
    rows: () => [["time_s", ...curves.map((one) => one.name)], ...Array.from(x, (time, k) => [time, ...curves.map((one) => one.y[k])])],
    note: "Solid: forward; dashed: up; dotted: right.",
  }, signal).element;
}

function peak(values: ArrayLike<number>): number {
  let most = 0;
  for (let k = 0; k < values.length; k += 1) if (Math.abs(values[k] ?? 0) > most) most = Math.abs(values[k] ?? 0);
  return most;
}
