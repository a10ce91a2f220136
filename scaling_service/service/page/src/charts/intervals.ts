/** A dot with a line from low to high for each name. */

import { number } from "../ui/words.ts";
import { base, nameAxis, valueAxis } from "./base.ts";
import type { Option } from "./engine.ts";
import { tip } from "./figure.ts";
import type { Ink } from "./ink.ts";

export interface Interval {
  name: string;
  low: number;
  middle: number;
  high: number;
  colour: string;
}

const LEFT = 170;

interface Drawing {
  coord: (at: [number, number]) => [number, number];
}

export function intervalsOption(ink: Ink, intervals: readonly Interval[], axis: string, left = LEFT, min?: number): Option {
  const common = base(ink, { left });
  return {
    ...common,
    tooltip: { ...(common.tooltip as object), trigger: "item", formatter: (found: unknown) => describe(intervals, found) },
    xAxis: valueAxis(ink, min === undefined ? { name: axis } : { name: axis, min }, "x"),
    yAxis: nameAxis(ink, intervals.map(({ name }) => name), left - 10),
    series: [
      {
        type: "custom",
        data: intervals.map(({ middle }, place) => [middle, place]),
        encode: { x: [0], y: [1] },
        renderItem: ({ dataIndex }: { dataIndex: number }, api: Drawing) => drawn(intervals[dataIndex], dataIndex, api),
      },
      {
        type: "line",
        data: [],
        markLine: { silent: true, symbol: "none", label: { show: false }, lineStyle: { color: ink.quiet, type: "solid" }, data: [{ xAxis: 0 }] },
      },
      { type: "scatter", symbolSize: 0, silent: true, data: intervals.flatMap(({ low, high }, place) => [[low, place], [high, place]]) },
    ],
  };
}

function drawn(interval: Interval | undefined, place: number, { coord }: Drawing): unknown {
  if (interval === undefined) return null;
  const [low, middle, high] = [interval.low, interval.middle, interval.high].map((value) => coord([value, place])) as [
    [number, number], [number, number], [number, number]];
  const stroke = { stroke: interval.colour, lineWidth: 3 };
  return {
    type: "group",
    children: [
      { type: "line", shape: { x1: low[0], y1: low[1], x2: high[0], y2: high[1] }, style: stroke },
      { type: "circle", shape: { cx: middle[0], cy: middle[1], r: 5 }, style: { fill: interval.colour } },
    ],
  };
}

function describe(intervals: readonly Interval[], found: unknown): HTMLElement {
  const interval = intervals[(found as { dataIndex: number }).dataIndex];
  if (interval === undefined) return tip("", []);
  const text = `${number(interval.middle)} (${number(interval.low)} to ${number(interval.high)})`;
  return tip(interval.name, [{ colour: interval.colour, text }]);
}
