/** Curves: one for each method over time or per cent of a cycle, with bands and marked stretches. */

import type { Style } from "../ui/palette.ts";
import { number } from "../ui/words.ts";
import { base, valueAxis, type Axis } from "./base.ts";
import type { Option } from "./engine.ts";
import { tip } from "./figure.ts";
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

export function linesOption(ink: Ink, lines: Lines): Option {
  const common = base(ink);
  return {
    ...common,
    tooltip: { ...(common.tooltip as object), trigger: "axis", formatter: (found: unknown) => describe(lines, found) },
    xAxis: valueAxis(ink, { min: "dataMin", max: "dataMax", ...lines.xAxis }, "x"),
    yAxis: valueAxis(ink, lines.yAxis, "y"),
    series: [
      ...lines.curves.flatMap((curve) => band(lines.x, curve)),
      ...lines.curves.map((curve, place) => series(ink, lines, curve, place === 0)),
    ],
  };
}

function series(ink: Ink, { x, marked, levels }: Lines, curve: Curve, first: boolean): Option {
  return {
    type: "line",
    name: curve.name,
    showSymbol: false,
    sampling: "minmax",
    color: curve.style.colour,
    lineStyle: { color: curve.style.colour, type: curve.style.dash, width: 2 },
    data: points(x, curve.y),
    ...(first && marked !== undefined ? { markArea: markedArea(ink, marked) } : {}),
    ...(first && levels !== undefined ? { markLine: levelLines(ink, levels) } : {}),
  };
}

/** A band is two hidden curves, one stacked on the other, with the area between them filled. */
function band(x: ArrayLike<number>, { name, style, y, half }: Curve): Option[] {
  if (half === undefined) return [];
  const edge = { type: "line", stack: `band ${name}`, stackStrategy: "all", showSymbol: false, silent: true,
    lineStyle: { width: 0, opacity: 0 }, tooltip: { show: false } };
  const low = Array.from(y, (value, k) => value - (half[k] ?? NaN));
  const width = Array.from(y, (_, k) => 2 * (half[k] ?? NaN));
  return [
    { ...edge, name: "", data: points(x, low) },
    { ...edge, name: "", data: points(x, width), areaStyle: { color: style.colour, opacity: 0.15 } },
  ];
}

function points(x: ArrayLike<number>, y: ArrayLike<number>): (number | null)[][] {
  return Array.from(y, (value, k) => [x[k] ?? k, Number.isFinite(value) ? value : null]);
}

function markedArea(ink: Ink, marked: readonly (readonly [number, number])[]): Option {
  return {
    silent: true,
    itemStyle: { color: ink.quiet, opacity: 0.16 },
    data: marked.map(([from, to]) => [{ xAxis: from }, { xAxis: to }]),
  };
}

function levelLines(ink: Ink, levels: readonly { y: number; name: string }[]): Option {
  return {
    silent: true,
    symbol: "none",
    lineStyle: { color: ink.text, type: "dashed" },
    label: { color: ink.text, position: "insideEndTop", formatter: ({ name }: { name: string }) => name },
    data: levels.map(({ y, name }) => ({ yAxis: y, name })),
  };
}

interface At {
  seriesName: string;
  color: string;
  value: [number, number | null];
}

function describe({ xAxis, unit }: Lines, found: unknown): HTMLElement {
  const all = (found as At[]).filter((one) => one.seriesName !== "");
  const rows = all.map((one) => ({ colour: one.color, text: `${one.seriesName}: ${number(one.value[1], 1)} ${unit}` }));
  return tip(`${xAxis.name}: ${number(all[0]?.value[0], 2)}`, rows);
}
