/** Marker × time of the error of one model in one recording; a click goes to that frame. */

import type { SceneTrial } from "../api/schema.ts";
import { darkest, drawHeat, HEAT_ABOVE, HEAT_BELOW, heatHeight, heatSides, type Heat } from "../charts/heat.ts";
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
  /** What is drawn darkest, mm. */
  top: number;
  /** RMS of each marker over all frames in which it is seen, mm. */
  rms: readonly number[];
  /** Move the cursor. */
  at: (frame: number) => void;
}

export async function errorMap(
  trial: SceneTrial,
  method: string,
  path: (file: string) => string,
  signal: AbortSignal,
  go: (frame: number, marker: string) => void,
  point: (frame: number, marker: string) => void,
  /** What is drawn darkest, mm, where maps are to be compared. */
  top?: number,
): Promise<ErrorMap> {
  const motion = trial.motions[method];
  if (motion === undefined) return { element: h("p", { class: "quiet" }, `${method} did not follow ${trial.name}.`), top: 0, rms: [], at: () => undefined };
  const { values, step } = await new Frames(motion.errors, path, signal, () => undefined).whole();
  const own = binned(trial, values, step);
  const heat = top === undefined ? own : { ...own, top };
  const worst = worstOf(heat, trial);
  const [most] = worst;
  const drawn = figure({
    title: `${method} in ${trial.name}: distance between measured and model marker, mm`,
    name: `error_${trial.name}_${method}_mm`,
    alt: `${heat.names.length} markers over time; the most is ${number(most?.value)} mm at ${most?.name ?? "none"}, ${number(most?.time, 2)} s.`,
    height: heatHeight(heat.names.length),
    drawing: (ink) => drawHeat(ink, heat),
    rows: () => rowsOf(heat),
    note: `The picture above shows the marker and the time that is pointed at; a click keeps them. Empty: not seen. The strongest colour stands for ${number(heat.top, 0)} mm and more, up to ${number(most?.value)} mm.`,
    clicked: (row, column) => go(heat.frames[column * heat.names.length + row] ?? 0, heat.names[row] ?? ""),
    pointed: (row, column) => point(heat.frames[column * heat.names.length + row] ?? 0, heat.names[row] ?? ""),
  }, signal);
  const cursor = h("div", { class: "cursor", "aria-hidden": "true" });
  vary(cursor, { "--high": `${heatHeight(heat.names.length) - HEAT_ABOVE - HEAT_BELOW}px` });
  const plot = drawn.element.querySelector<HTMLElement>(".plot");
  plot?.after(h("div", { class: "cursors" }, cursor));
  const moments = worst.map(({ name, frame, time, value }) =>
    h("button", { class: "small", onclick: () => go(frame, name) }, `${name} ${number(value)} mm at ${number(time, 2)} s`));
  return {
    top: heat.top,
    rms: trial.labels.map((_, k) => rmsOf(values, k, trial.labels.length)),
    element: h("div", null, h("div", { class: "actions" }, h("span", { class: "quiet" }, "Worst:"), ...moments), drawn.element),
    at: (frame) => {
      const { left, right } = heatSides(heat.names);
      const width = (plot?.clientWidth ?? 0) - left - right;
      cursor.style.transform = `translateX(${left + (width * frame) / Math.max(trial.frames - 1, 1)}px)`;
    },
  };
}

/** RMS of every `width`-th value from `first` on, of those that are known. */
function rmsOf(values: Float32Array, first: number, width: number): number {
  let [sum, count] = [0, 0];
  for (let k = first; k < values.length; k += width) {
    const value = values[k] ?? NaN;
    if (Number.isNaN(value)) continue;
    sum += value ** 2;
    count += 1;
  }
  return Math.sqrt(sum / count);
}

interface Binned extends Heat {
  /** The frame of each value. */
  frames: Uint32Array;
}

/** The most of each marker within each column of time, and the frame in which it is. */
function binned(trial: SceneTrial, values: Float32Array, step: number): Binned {
  const names = trial.labels;
  const rows = Math.floor(values.length / names.length);
  const columns = Math.min(rows, MOST_COLUMNS);
  const found = new Float32Array(columns * names.length).fill(NaN);
  const frames = new Uint32Array(found.length);
  for (let row = 0; row < rows; row += 1) {
    const column = Math.floor((row * columns) / rows);
    for (let k = 0; k < names.length; k += 1) {
      const value = values[row * names.length + k] ?? NaN;
      const place = column * names.length + k;
      if (!(value <= (found[place] ?? NaN)) && !Number.isNaN(value)) [found[place], frames[place]] = [value, row * step];
    }
  }
  const times = Array.from({ length: columns }, (_, k) => trial.start_s + (Math.ceil((k * rows) / columns) * step) / trial.rate_hz);
  const span = [trial.start_s, trial.start_s + trial.frames / trial.rate_hz] as const;
  return { names, span, times, values: found, frames, top: darkest(found), unit: "mm" };
}

interface Moment {
  name: string;
  frame: number;
  time: number;
  value: number;
}

/** The worst moment of each of the worst markers, the largest first. */
function worstOf({ names, times, values, frames }: Binned, { start_s, rate_hz }: SceneTrial): Moment[] {
  const found = names.map((name, k): Moment => {
    let column = 0;
    for (let c = 0; c < times.length; c += 1) {
      if ((values[c * names.length + k] ?? NaN) > (values[column * names.length + k] || 0)) column = c;
    }
    const place = column * names.length + k;
    const frame = frames[place] ?? 0;
    return { name, frame, time: start_s + frame / rate_hz, value: values[place] ?? NaN };
  });
  return found.filter(({ value }) => Number.isFinite(value)).sort((a, b) => b.value - a.value).slice(0, WORST);
}

function rowsOf({ names, times, values }: Heat): (string | number)[][] {
  const rows = Array.from(times, (time, column) => [
    Number(time.toFixed(4)), ...names.map((_, k) => Number((values[column * names.length + k] ?? NaN).toFixed(2)))]);
  return [["time_s", ...names], ...rows];
}
