/** A heat map: names against time, darkest where most. */

import { number } from "../ui/words.ts";
import { base, describe, nameAxis, namesRoom, plain, valueAxis, type Drawing, type Layout } from "./base.ts";
import type { Ink } from "./ink.ts";

export interface Heat {
  names: readonly string[];
  /** From when to when, s: the columns share it evenly. */
  span: readonly [number, number];
  /** Time at the beginning of each column, s. */
  times: ArrayLike<number>;
  /** Name after name within a column: `values[column * names.length + row]`; NaN where nothing is known. */
  values: ArrayLike<number>;
  top: number;
  unit: string;
}

/** Room beside the drawing, px. */
export const heatSides = (names: readonly string[]): { left: number; right: number } => ({ left: namesRoom(names), right: 76 });
export const HEAT_ABOVE = 6;
export const HEAT_BELOW = 38;

export function drawHeat(ink: Ink, heat: Heat): Drawing {
  const { names, span, times, top, unit } = heat;
  const [start, end] = span;
  const width = (end - start) / times.length;
  const sides = heatSides(names);
  const rows = names.map((_, row) => Array.from(times, (_time, column) => heat.values[column * names.length + row] ?? NaN));
  return {
    data: [{
      type: "heatmap",
      x0: start + width / 2,
      dx: width,
      z: rows.map((row) => row.map((value) => (Number.isFinite(value) ? value : null))),
      zmin: 0,
      zmax: top,
      ygap: 1,
      colorscale: ink.heat.map((colour, k) => [k / (ink.heat.length - 1), colour]),
      showscale: false,
      hovertext: rows.map((row, k) => row.map((value, column) =>
        (Number.isFinite(value) ? describe(names[k] ?? "", `${number(value)} ${unit} at ${number(times[column], 2)} s`) : ""))),
      hoverinfo: "text",
      hoverongaps: false,
    }],
    layout: {
      ...base(ink, { ...sides, top: HEAT_ABOVE, bottom: HEAT_BELOW }),
      xaxis: valueAxis(ink, { name: "time, s", range: [start, end] }, "x"),
      yaxis: nameAxis(ink, names, sides.left - 10),
      ...scale(ink, `≥ ${number(top, 0)} ${unit}`),
    },
  };
}

/** Of the scale of colours, px. */
const SCALE = { left: 14, width: 10, height: 110 };
const STEPS = 22;

/** The scale of colours beside the drawing: plotly's own writes styles, which the page's policy forbids. */
function scale(ink: Ink, most: string): Layout {
  const [right, low] = [SCALE.left + SCALE.width, -SCALE.height / 2];
  const at = (k: number): number => low + (SCALE.height * k) / STEPS;
  const beside = { xref: "paper", yref: "paper", x: 1, y: 0.5 };
  return {
    shapes: Array.from({ length: STEPS }, (_, k) => ({
      type: "rect",
      xref: "paper", xsizemode: "pixel", xanchor: 1, x0: SCALE.left, x1: right,
      yref: "paper", ysizemode: "pixel", yanchor: 0.5, y0: at(k), y1: at(k + 1),
      fillcolor: between(ink.heat, k / (STEPS - 1)),
      line: { width: 0 },
    })),
    annotations: ([[low, "0"], [-low, most]] as const).map(([yshift, text]) => ({
      ...beside, xshift: right + 2, yshift, xanchor: "left", yanchor: "middle", text: plain(text), showarrow: false, font: { color: ink.quiet, size: 11 },
    })),
  };
}

/** The colour at a share of the way through some, `#rrggbb`. */
function between(colours: readonly string[], share: number): string {
  const place = share * (colours.length - 1);
  const first = Math.min(Math.floor(place), colours.length - 2);
  const parts = (colour = ""): number[] => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
  const [from, to] = [parts(colours[first]), parts(colours[first + 1])];
  return `rgb(${from.map((value, k) => Math.round(value + (place - first) * ((to[k] ?? 0) - value))).join(",")})`;
}

export const heatHeight = (count: number): number => Math.max(150, 60 + 15 * count);

/** What is drawn darkest: what only a few cells exceed, so that these do not hide the rest. */
export function darkest(values: ArrayLike<number>): number {
  const known = Array.from(values).filter(Number.isFinite).sort((a, b) => a - b);
  return Math.max(known[Math.floor(0.98 * (known.length - 1))] ?? 1, 1e-9);
}
