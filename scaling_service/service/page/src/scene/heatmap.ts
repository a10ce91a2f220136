/** Marker × time of the error of one model in one recording; a click goes to that frame. */

import type { SceneTrial } from "../api/schema.ts";
import { darkest, HEAT_ABOVE, HEAT_BELOW, HEAT_SIDES, heatHeight, heatOption, type Heat } from "../charts/heat.ts";
import { figure } from "../charts/figure.ts";
import { h, vary } from "../ui/dom.ts";
import { number } from "../ui/words.ts";
import { Frames } from "./frames.ts";

/** Chosen: more columns than these are narrower than a finger, and slow to save as SVG. */
const MOST_COLUMNS = 240;
/** Markers whose worst moment can be reached by a button. */
const WORST = 5;

export interface ErrorMap {
  element: HTMLElement;
  /** Move the cursor. */
  at: (frame: number) => void;
}

export async function errorMap(
  trial: SceneTrial,
  method: string,
  path: (file: string) => string,
  signal: AbortSignal,
  go: (frame: number, marker: string) => void,
): Promise<ErrorMap> {
  const motion = trial.motions[method];
  if (motion === undefined) return { element: h("p", { class: "quiet" }, `${method} did not follow ${trial.name}.`), at: () => undefined };
  const { values, step } = await new Frames(motion.errors, path, signal, () => undefined).whole();
  const heat = binned(trial, values, step);
  const framesPerColumn = trial.frames / heat.times.length;
  const worst = worstOf(heat);
  const [most] = worst;
  const frameOf = (column: number): number => Math.round((column + 0.5) * framesPerColumn);
  const drawn = figure({
    title: `${method} in ${trial.name}: distance between measured and model marker, mm`,
    name: `error_${trial.name}_${method}_mm`,
    alt: `${heat.names.length} markers over time; the most is ${number(most?.value)} mm at ${most?.name ?? "none"}, ${number(most?.time, 2)} s.`,
    height: heatHeight(heat.names.length),
    option: (ink) => heatOption(ink, heat),
    rows: () => rowsOf(heat),
    note: "A click shows the marker at that time. Grey gaps: not seen.",
    drawn: (chart) => {
      chart.on("click", (event) => {
        const [column, row] = event.value as [number, number];
        go(frameOf(column), heat.names[row] ?? "");
      });
    },
  }, signal);
  const cursor = h("div", { class: "cursor", "aria-hidden": "true" });
  vary(cursor, { "--high": `${heatHeight(heat.names.length) - HEAT_ABOVE - HEAT_BELOW}px` });
  const plot = drawn.element.querySelector<HTMLElement>(".plot");
  plot?.after(h("div", { class: "cursors" }, cursor));
  const moments = worst.map(({ name, column, time, value }) =>
    h("button", { class: "small", onclick: () => go(frameOf(column), name) }, `${name} ${number(value)} mm at ${number(time, 2)} s`));
  return {
    element: h("div", null, drawn.element, h("div", { class: "actions" }, h("span", { class: "quiet" }, "Worst:"), ...moments)),
    at: (frame) => {
      const width = (plot?.clientWidth ?? 0) - HEAT_SIDES.left - HEAT_SIDES.right;
      cursor.style.transform = `translateX(${HEAT_SIDES.left + (width * frame) / Math.max(trial.frames - 1, 1)}px)`;
    },
  };
}

/** The most of each marker within each column of time. */
function binned(trial: SceneTrial, values: Float32Array, step: number): Heat {
  const names = trial.labels;
  const rows = Math.floor(values.length / names.length);
  const columns = Math.min(rows, MOST_COLUMNS);
  const found = new Float32Array(columns * names.length).fill(NaN);
  for (let row = 0; row < rows; row += 1) {
    const column = Math.floor((row * columns) / rows);
    for (let k = 0; k < names.length; k += 1) {
      const value = values[row * names.length + k] ?? NaN;
      const place = column * names.length + k;
      if (!(value <= (found[place] ?? NaN)) && !Number.isNaN(value)) found[place] = value;
    }
  }
  const times = Array.from({ length: columns }, (_, k) => trial.start_s + ((k + 0.5) * rows * step) / columns / trial.rate_hz);
  return { names, times, values: found, top: darkest(found), unit: "mm" };
}

interface Moment {
  name: string;
  column: number;
  time: number;
  value: number;
}

/** The worst moment of each of the worst markers, the largest first. */
function worstOf({ names, times, values }: Heat): Moment[] {
  const found = names.map((name, k): Moment => {
    let column = 0;
    for (let c = 0; c < times.length; c += 1) {
      if ((values[c * names.length + k] ?? NaN) > (values[column * names.length + k] || 0)) column = c;
    }
    return { name, column, time: times[column] ?? 0, value: values[column * names.length + k] ?? NaN };
  });
  return found.filter(({ value }) => Number.isFinite(value)).sort((a, b) => b.value - a.value).slice(0, WORST);
}

function rowsOf({ names, times, values }: Heat): (string | number)[][] {
  const rows = Array.from(times, (time, column) => [
    Number(time.toFixed(4)), ...names.map((_, k) => Number((values[column * names.length + k] ?? NaN).toFixed(2)))]);
  return [["time_s", ...names], ...rows];
}
