/** The ground wrench over time: measured, and as motions explain it. */

import { getJson } from "../api/http.ts";
import { filePath } from "../api/jobs.ts";
import { Problem } from "../api/problem.ts";
import type { WrenchScene, WrenchTrial } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawLines, type Curve } from "../charts/lines.ts";
import type { Ink } from "../charts/ink.ts";
import { Frames } from "../scene/frames.ts";
import { pathIn } from "../scene/scene.ts";
import { h } from "../ui/dom.ts";
import type { Style } from "../ui/palette.ts";

const COMPONENTS = ["force forward, N", "force up, N", "force right, N", "moment x, N m", "moment y, N m", "moment z, N m"];
/** Colours of Okabe & Ito 2008. */
const STYLES: Record<string, Style> = {
  classical: { colour: "#0072B2", dash: "dash" },
  consistent: { colour: "#D55E00", dash: "solid" },
  predicted: { colour: "#009E73", dash: "dot" },
};

export async function wrenches(job: string, signal: AbortSignal): Promise<HTMLElement> {
  const found = await getJson<WrenchScene>(filePath(job, "scene/wrenches.json"), signal).catch((error: unknown) => {
    if (error instanceof Problem && error.status === 404) return null; // made by an older version
    throw error;
  });
  if (found === null) return h("p", { class: "quiet" }, "The ground wrench over time is not kept with this job; ask for the same again to see it.");
  const drawn = await Promise.all(Object.entries(found.trials).map(([name, trial]) => drawings(name, trial, job, signal)));
  return h("div", { class: "grid" }, ...drawn.flat());
}

async function drawings(name: string, trial: WrenchTrial, job: string, signal: AbortSignal): Promise<HTMLElement[]> {
  const ways = await Promise.all(Object.entries(trial.wrenches).map(async ([way, stored]) =>
    ({ way, ...(await new Frames(stored, pathIn(job), signal, () => undefined).whole()) })));
  const x = Float64Array.from({ length: (ways[0]?.values.length ?? 0) / 6 }, (_, k) => trial.start_s + (k * (ways[0]?.step ?? 1)) / trial.rate_hz);
  return COMPONENTS.flatMap((title, k) => {
    if (trial.components[k] !== true) return [];
    const curves = (ink: Ink): Curve[] => ways.map(({ way, values }) =>
      ({ name: way, style: STYLES[way] ?? { colour: ink.measured, dash: "solid" }, y: Float32Array.from(x, (_, row) => values[6 * row + k] ?? NaN) }));
    return [figure({
      title: `${name}: ${title}`,
      name: `wrench_${name}_${k}`,
      alt: `${title} of ${name} over time, measured and in ${ways.length - 1} ways.`,
      zoom: true,
      height: 230,
      drawing: (ink) => drawLines(ink, { x, curves: curves(ink), unit: title.split(", ")[1] ?? "", xAxis: { name: "time, s" }, yAxis: { name: title } }),
      rows: () => [["time_s", ...ways.map(({ way }) => way)], ...Array.from(x, (time, row) => [time, ...ways.map(({ values }) => values[6 * row + k])])],
      note: "Solid dark: measured; dashed: classical; solid: consistent; dotted: predicted.",
    }, signal).element];
  });
}
