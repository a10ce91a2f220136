/** Ranked bars, one for each name, with a mark on each such as its floor. */

import { figures } from "../ui/words.ts";
import { base, describe, nameAxis, namesRoom, valueAxis, type Drawing } from "./base.ts";
import type { Ink } from "./ink.ts";

export interface Bar {
  name: string;
  value: number | null;
  colour: string;
  mark?: number | null | undefined;
}

export interface Bars {
  bars: Bar[];
  axis: string;
  unit: string;
  /** What the marks are. */
  marks?: string;
}

export function drawBars(ink: Ink, { bars, axis, unit, marks }: Bars): Drawing {
  const left = namesRoom(bars.map(({ name }) => name));
  const marked = bars.map(({ mark }) => mark ?? null);
  return {
    data: [
      {
        type: "bar",
        orientation: "h",
        width: 0.7,
        x: bars.map(({ value }) => value),
        y: bars.map((_, k) => k),
        marker: { color: bars.map(({ colour }) => colour) },
        hovertext: bars.map(({ name, value, mark }) => describe(name, `${figures(value)} ${unit}`,
          ...(marks !== undefined && typeof mark === "number" ? [`${marks}: ${figures(mark)} ${unit}`] : []))),
        hoverinfo: "text",
      },
      {
        type: "scatter",
        mode: "markers",
        x: marked,
        y: marked.map((_, k) => k),
        marker: { symbol: "line-ns", size: 14, line: { color: ink.text, width: 3 } },
        hoverinfo: "skip",
      },
    ],
    layout: {
      ...base(ink, { left }),
      xaxis: valueAxis(ink, { name: axis, fromZero: true }, "x"),
      yaxis: nameAxis(ink, bars.map(({ name }) => name), left - 10),
      hovermode: "y",
    },
  };
}

export const barsHeight = (count: number): number => Math.max(150, 70 + 20 * count);
