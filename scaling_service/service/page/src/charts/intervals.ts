/** A dot with a line from low to high for each name. */

import { number } from "../ui/words.ts";
import { base, describe, nameAxis, valueAxis, type Drawing } from "./base.ts";
import type { Ink } from "./ink.ts";

export interface Interval {
  name: string;
  low: number;
  middle: number;
  high: number;
  colour: string;
}

const LEFT = 170;

export function drawIntervals(ink: Ink, intervals: readonly Interval[], axis: string, left = LEFT, fromZero = false): Drawing {
  return {
    data: intervals.map(({ name, low, middle, high, colour }, k) => ({
      type: "scatter",
      mode: "markers",
      x: [middle],
      y: [k],
      marker: { size: 10, color: colour },
      error_x: { array: [high - middle], arrayminus: [middle - low], color: colour, thickness: 3, width: 0 },
      hovertext: describe(name, `${number(middle)} (${number(low)} to ${number(high)})`),
      hoverinfo: "text",
    })),
    layout: {
      ...base(ink, { left }),
      xaxis: { ...valueAxis(ink, { name: axis, fromZero }, "x"), zeroline: true, zerolinecolor: ink.quiet },
      yaxis: nameAxis(ink, intervals.map(({ name }) => name), left - 10),
      hovermode: "y",
    },
  };
}
