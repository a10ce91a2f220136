/** A dot for each subject and a line for the mean, method beside method. */

import { figures } from "../ui/words.ts";
import { base, describe, plain, valueAxis, type Drawing } from "./base.ts";
import type { Ink } from "./ink.ts";

export interface DotGroup {
  name: string;
  colour: string;
  /** Of each subject. */
  values: readonly { subject: string; value: number }[];
  mean: number | undefined;
}

export function drawDots(ink: Ink, groups: readonly DotGroup[], unit: string, logarithmic = false): Drawing {
  const values = groups.flatMap((group) => group.values.map(({ value }) => value));
  const low = Math.min(...values);
  const fromZero = low >= 0 && low < Math.max(...values) / 2; // else what differs would be too small to see
  const places = groups.map((_, k) => k);
  return {
    data: [
      ...groups.map(({ name, colour, values: all }, k) => ({
        type: "scatter",
        mode: "markers",
        x: all.map(() => k),
        y: all.map(({ value }) => value),
        marker: { size: 7, color: colour, opacity: 0.75 },
        hovertext: all.map(({ subject, value }) => describe(subject, `${name}: ${figures(value)} ${unit}`)),
        hoverinfo: "text",
      })),
      {
        type: "scatter",
        mode: "markers",
        x: places,
        y: groups.map(({ mean }) => mean ?? null),
        marker: { symbol: "line-ew", size: 34, line: { color: ink.text, width: 3 } },
        hoverinfo: "skip",
      },
    ],
    layout: {
      ...base(ink),
      xaxis: {
        tickvals: places,
        ticktext: groups.map(({ name }) => plain(name)),
        range: [-0.5, groups.length - 0.5],
        fixedrange: true,
        showgrid: false,
        zeroline: false,
        showline: true,
        linecolor: ink.quiet,
      },
      yaxis: { ...valueAxis(ink, { name: unit, fromZero: fromZero && !logarithmic }, "y"), ...(logarithmic ? { type: "log", dtick: 1 } : {}) },
    },
  };
}
