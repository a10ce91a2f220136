/** Plotly, which the reports draw with, too: its parts for axes in the plane. */

import plotly from "plotly.js-cartesian-dist-min";
import type { Drawing } from "./base.ts";

const CONFIG = { displayModeBar: false, doubleClick: "reset", showTips: false };

/** Draw into a place, or draw anew what is in it. */
export async function draw(place: HTMLElement, { data, layout }: Drawing): Promise<void> {
  await plotly.react(place, data, layout, CONFIG);
}

export const resize = (place: HTMLElement): void => void plotly.Plots.resize(place);

/** Show what stands at a value of x as a pointer there would, null to show nothing; nobody is told of it. */
export function point(place: HTMLElement, x: number | null): void {
  if (x === null) plotly.Fx.unhover(place);
  else plotly.Fx.hover(place, { xval: x }, "xy", true);
}

export const purge = (place: HTMLElement): void => plotly.purge(place);

/** The text of an SVG document. */
export const asSvg = (drawing: Drawing, width: number, height: number): Promise<string> =>
  plotly.toImage(drawing, { format: "svg", width, height, imageDataOnly: true });

const PNG_SCALE = 3;

/** A PNG in base 64. */
export const asPng = (drawing: Drawing, width: number, height: number): Promise<string> =>
  plotly.toImage(drawing, { format: "png", width, height, scale: PNG_SCALE, imageDataOnly: true });
