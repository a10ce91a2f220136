/** Curves: one for each method over time or per cent of a cycle, with bands and marked stretches. */

import type { Style } from "../ui/palette.ts";
import { base, plain, valueAxis, type Axis, type Drawing, type Layout, type Trace } from "./base.ts";
import type { Ink } from "./ink.ts";

export interface Curve {
  name: string;
  style: Style;
  y: ArrayLike<number>;
  /** Half the width of the band around it, such as a standard deviation. */
  half?: ArrayLike<number> | undefined;
}

export interface Lines {
  x: ArrayLike<number>;
  curves: Curve[];
  xAxis: Axis;
  yAxis: Axis;
  /** Stretches of x that are marked. */
  marked?: readonly (readonly [number, number])[] | undefined;
  /** Level lines, such as limits. */
  levels?: readonly { y: number; name: string }[] | undefined;
  unit: string;
}

/** A range for what is level but for rounding, which would fill the axis; nothing for others. */
function opened(curves: readonly Curve[]): { range?: [number, number] } {
  let [low, high] = [Infinity, -Infinity];
  for (const { y } of curves) for (const value of Array.from(y)) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  const room = Math.max(Math.abs(low), 1) / 10;
  return high - low < AT_STOP ? { range: [low - room, high + room] } : {};
}

/** Chosen: beyond rounding of what is sent. */
const AT_STOP = 1e-3;

/** The ends of a range that curves stand at, as levels, and the stretches of x in which one does. */
export function stops(x: ArrayLike<number>, curves: readonly Curve[], range: readonly [number, number] | null | undefined): Pick<Lines, "marked" | "levels"> {
  const at = (end: number) => (k: number): boolean => curves.some(({ y }) => Math.abs((y[k] ?? NaN) - end) < AT_STOP);
  const frames = Array.from({ length: x.length }, (_, k) => k);
  const reached = (range ?? []).filter((end) => frames.some(at(end)));
  const marked: [number, number][] = [];
  let from = -1;
  for (let k = 0; k <= x.length; k += 1) {
    if (k < x.length && reached.some((end) => at(end)(k))) from = from < 0 ? k : from;
    else if (from >= 0) {
      marked.push([x[from] ?? NaN, x[k - 1] ?? NaN]);
      from = -1;
    }
  }
  return { marked, levels: reached.map((y) => ({ y, name: "stop" })) };
}

export function drawLines(ink: Ink, { x: every, curves: whole, xAxis, yAxis, marked = [], levels = [], unit }: Lines): Drawing {
  const kept = outstanding(whole, every.length);
  const some = (values: ArrayLike<number>): Float64Array => Float64Array.from(kept, (k) => values[k] ?? NaN);
  const x = some(every);
  const curves = whole.map((curve): Curve => ({ ...curve, y: some(curve.y), half: curve.half && some(curve.half) }));
  return {
    data: [...curves.flatMap((curve) => band(x, curve)), ...curves.map((curve) => line(x, curve, unit))],
    layout: {
      ...base(ink),
      xaxis: { range: [x[0] ?? 0, x[x.length - 1] ?? 1], ...valueAxis(ink, xAxis, "x"), unifiedhovertitle: { text: `${plain(xAxis.name)}: %{x:.6~r}` } },
      yaxis: valueAxis(ink, { ...opened(curves), ...yAxis }, "y"),
      hovermode: "x unified",
      shapes: [...marked.map((span) => area(ink, span)), ...levels.map(({ y }) => level(ink, y))],
      annotations: levels.filter(({ name }) => name !== "").map(({ y, name }) => (
        { text: plain(name), x: 1, xref: "paper", xanchor: "right", y, yanchor: "bottom", showarrow: false })),
    },
  };
}

/** Chosen: more stretches than these lie within a pixel of one another. */
const STRETCHES = 1000;

/** Of a long recording the least and the largest of each curve in short stretches; of a short one all. */
function outstanding(curves: readonly Curve[], count: number): number[] {
  if (count <= 2 * STRETCHES) return Array.from({ length: count }, (_, k) => k);
  const kept = new Set([0, count - 1]);
  for (const { y } of curves) {
    for (let stretch = 0; stretch < STRETCHES; stretch += 1) {
      const [from, to] = [stretch, stretch + 1].map((edge) => Math.floor((edge * count) / STRETCHES)) as [number, number];
      let [low, high] = [from, from];
      for (let k = from; k < to; k += 1) {
        if ((y[k] ?? NaN) < (y[low] ?? NaN) || !Number.isFinite(y[low])) low = k;
        if ((y[k] ?? NaN) > (y[high] ?? NaN) || !Number.isFinite(y[high])) high = k;
      }
      kept.add(low).add(high);
    }
  }
  return [...kept].sort((a, b) => a - b);
}

const line = (x: ArrayLike<number>, { name, style, y }: Curve, unit: string): Trace => ({
  type: "scatter",
  mode: "lines",
  name: plain(name),
  x,
  y,
  line: { color: style.colour, dash: style.dash, width: 2 },
  hovertemplate: `%{y:.1f} ${plain(unit)}`,
});

/** One outline around each stretch in which the curve is known. */
function band(x: ArrayLike<number>, { style, y, half }: Curve): Trace[] {
  if (half === undefined) return [];
  const outline: [number | null, number | null][] = [];
  const close = (from: number, to: number): void => {
    for (let k = from; k < to; k += 1) outline.push([x[k] ?? NaN, (y[k] ?? NaN) + (half[k] ?? NaN)]);
    for (let k = to - 1; k >= from; k -= 1) outline.push([x[k] ?? NaN, (y[k] ?? NaN) - (half[k] ?? NaN)]);
    outline.push([null, null]);
  };
  let from = 0;
  for (let k = 0; k <= y.length; k += 1) {
    if (k < y.length && Number.isFinite(y[k]) && Number.isFinite(half[k])) continue;
    if (k > from) close(from, k);
    from = k + 1;
  }
  return [{
    type: "scatter",
    mode: "lines",
    x: outline.map(([at]) => at),
    y: outline.map(([, value]) => value),
    line: { width: 0 },
    fill: "toself",
    fillcolor: `${style.colour}26`, // 15 %
    hoverinfo: "skip",
  }];
}

const area = (ink: Ink, [x0, x1]: readonly [number, number]): Layout => (
  { type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, fillcolor: ink.quiet, opacity: 0.16, line: { width: 0 }, layer: "below" });

const level = (ink: Ink, y: number): Layout => (
  { type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: { color: ink.text, dash: "dash", width: 1 } });
