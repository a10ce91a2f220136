/** What all figures have in common. */

import type { Layout, Trace } from "plotly.js-cartesian-dist-min";
import { FONT, type Ink } from "./ink.ts";

export type { Layout, Trace };
export interface Drawing {
  data: Trace[];
  layout: Layout;
}

export interface Axis {
  name: string;
  /** Both ends; without them, where the values end. */
  range?: [number, number];
  /** From zero to where the values end. */
  fromZero?: boolean;
}

export interface Margins {
  left?: number;
  right?: number;
  top?: number;
  bottom?: number;
}

/** Room around the drawing, letters, nothing that catches a finger which scrolls the page, a quiet tooltip. */
export function base(ink: Ink, { left = 52, right = 14, top = 12, bottom = 40 }: Margins = {}): Layout {
  return {
    font: { family: FONT, color: ink.text, size: 12 },
    margin: { l: left, r: right, t: top, b: bottom },
    paper_bgcolor: ink.paper,
    plot_bgcolor: ink.paper,
    showlegend: false,
    dragmode: false,
    hovermode: "closest",
    hoverlabel: { bgcolor: ink.paper, bordercolor: ink.quiet, align: "left", font: { family: FONT, color: ink.text, size: 12 } },
  };
}

export function valueAxis(ink: Ink, { name, range, fromZero }: Axis, where: "x" | "y"): Layout {
  return {
    title: { text: plain(name), font: { color: ink.quiet }, standoff: 6 },
    tickfont: { color: ink.quiet },
    fixedrange: true,
    showgrid: where === "y",
    gridcolor: ink.line,
    zeroline: false,
    showline: where === "x",
    linecolor: ink.quiet,
    ...(range === undefined ? {} : { range }),
    ...(fromZero === true ? { rangemode: "tozero" } : {}),
  };
}

/** Names down the side, the first at the top: number `k` lies at `k`. */
export function nameAxis(ink: Ink, names: readonly string[], width: number): Layout {
  return {
    tickvals: names.map((_, k) => k),
    ticktext: names.map((name) => plain(shortened(name, width))),
    tickfont: { color: ink.text, size: 11 },
    range: [names.length - 0.5, -0.5],
    fixedrange: true,
    showgrid: false,
    zeroline: false,
    showline: true,
    linecolor: ink.quiet,
  };
}

/** Width of a letter of 11 px on average, px. */
const LETTER = 6.2;
/** Chosen: names may take so much of a page; longer ones are cut. */
const MOST_NAMES = 0.4;

/** Room for names down the side, px. */
export const namesRoom = (names: readonly string[], least = 84): number =>
  Math.round(Math.min(Math.max(LETTER * Math.max(...names.map(({ length }) => length), 0) + 16, least), Math.max(MOST_NAMES * innerWidth, least), 480));

function shortened(name: string, width: number): string {
  const most = Math.floor(width / LETTER);
  // Names of one cluster differ at their ends.
  const end = Math.floor(most / 2);
  return name.length > most ? `${name.slice(0, most - end - 1)}…${name.slice(-end)}` : name;
}

/** Text for plotly, which takes some HTML in titles and labels: shown as it is. */
export const plain = (text: string): string => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

/** What a pointer at a point is shown. */
export const describe = (name: string, ...lines: string[]): string => [name, ...lines].map(plain).join("<br>");
