/** A heat map: names against time, darkest where most. */

import { number } from "../ui/words.ts";
import { base, nameAxis } from "./base.ts";
import type { Option } from "./engine.ts";
import { tip } from "./figure.ts";
import type { Ink } from "./ink.ts";

export interface Heat {
  names: readonly string[];
  /** Of each column, s. */
  times: ArrayLike<number>;
  /** Name after name within a column: `values[column * names.length + row]`; NaN where nothing is known. */
  values: ArrayLike<number>;
  top: number;
  unit: string;
}

/** Room beside the drawing, px. */
export const HEAT_SIDES = { left: 84, right: 76 };
export const HEAT_ABOVE = 6;
export const HEAT_BELOW = 38;

export function heatOption(ink: Ink, heat: Heat): Option {
  const common = base(ink, { ...HEAT_SIDES, top: HEAT_ABOVE, bottom: HEAT_BELOW });
  const columns = Array.from(heat.times);
  return {
    ...common,
    tooltip: { ...(common.tooltip as object), trigger: "item", formatter: (found: unknown) => describe(heat, found) },
    xAxis: {
      type: "category",
      data: columns,
      name: "time, s",
      nameLocation: "middle",
      nameGap: 22,
      nameTextStyle: { color: ink.quiet },
      axisLabel: { color: ink.quiet, ...roundTimes(columns) },
      axisTick: { show: false },
    },
    yAxis: { ...nameAxis(ink, heat.names, HEAT_SIDES.left - 10), splitArea: { show: false } },
    visualMap: {
      min: 0,
      max: heat.top,
      orient: "vertical",
      right: 0,
      top: "middle",
      itemWidth: 10,
      itemHeight: 110,
      text: [`≥ ${number(heat.top, 0)} ${heat.unit}`, "0"],
      textStyle: { color: ink.quiet },
      inRange: { color: ink.heat },
    },
    series: [{ type: "heatmap", data: cells(heat), progressive: 0, itemStyle: { borderWidth: 0 }, emphasis: { disabled: true } }],
  };
}

/** Labels at the first column of every whole step of time. */
function roundTimes(times: readonly number[]): object {
  const least = ((times.at(-1) ?? 0) - (times[0] ?? 0)) / 12;
  const ten = 10 ** Math.floor(Math.log10(Math.max(least, 1e-3)));
  const step = ten * ([1, 2, 5].find((one) => one * ten >= least) ?? 10);
  const steps = (column: number): number => Math.floor((times[column] ?? -step) / step + 1e-6);
  return {
    interval: (column: number) => steps(column) > (column === 0 ? ((times[0] ?? 0) - 1e-6) / step : steps(column - 1)),
    formatter: (_: unknown, column: number) => String(Number((steps(column) * step).toPrecision(6))),
  };
}

export const heatHeight = (count: number): number => Math.max(150, 60 + 15 * count);

/** What is drawn darkest: what only a few cells exceed, so that these do not hide the rest. */
export function darkest(values: ArrayLike<number>): number {
  const known = Array.from(values).filter(Number.isFinite).sort((a, b) => a - b);
  return Math.max(known[Math.floor(0.98 * (known.length - 1))] ?? 1, 1e-9);
}

function cells({ names, times, values }: Heat): number[][] {
  const found: number[][] = [];
  for (let column = 0; column < times.length; column += 1) {
    for (let row = 0; row < names.length; row += 1) {
      const value = values[column * names.length + row] ?? NaN;
      if (Number.isFinite(value)) found.push([column, row, value]);
    }
  }
  return found;
}

function describe({ names, times, unit }: Heat, found: unknown): HTMLElement {
  const { value, color } = found as { value: [number, number, number]; color: string };
  const text = `${number(value[2])} ${unit} at ${number(times[value[0]], 2)} s`;
  return tip(names[value[1]] ?? "", [{ colour: color, text }]);
}
