/** A dot for each subject and a line for the mean, method beside method. */

import { figures } from "../ui/words.ts";
import { base, valueAxis } from "./base.ts";
import type { Option } from "./engine.ts";
import { tip } from "./figure.ts";
import type { Ink } from "./ink.ts";

export interface DotGroup {
  name: string;
  colour: string;
  /** Of each subject. */
  values: readonly { subject: string; value: number }[];
  mean: number | undefined;
}

export function dotsOption(ink: Ink, groups: readonly DotGroup[], unit: string): Option {
  const common = base(ink);
  const values = groups.flatMap((group) => group.values.map(({ value }) => value));
  const low = Math.min(...values);
  const fromZero = low >= 0 && low < Math.max(...values) / 2; // else what differs would be too small to see
  return {
    ...common,
    tooltip: { ...(common.tooltip as object), trigger: "item", formatter: (found: unknown) => describe(groups, unit, found) },
    xAxis: {
      type: "category",
      data: groups.map(({ name }) => name),
      axisLabel: { color: ink.text, interval: 0 },
      axisLine: { lineStyle: { color: ink.quiet } },
      axisTick: { show: false },
    },
    yAxis: valueAxis(ink, fromZero ? { name: unit, min: 0 } : { name: unit }, "y"),
    series: [
      {
        type: "scatter",
        symbolSize: 7,
        data: groups.flatMap(({ values, colour }, place) =>
          values.map(({ value }) => ({ value: [place, value], itemStyle: { color: colour, opacity: 0.75 } }))),
      },
      {
        type: "scatter",
        symbol: "rect",
        symbolSize: [34, 3],
        silent: true,
        itemStyle: { color: ink.text },
        data: groups.flatMap(({ mean }, place) => (mean === undefined ? [] : [[place, mean]])),
      },
    ],
  };
}

function describe(groups: readonly DotGroup[], unit: string, found: unknown): HTMLElement {
  const { value, color } = found as { value: [number, number]; color: string };
  const group = groups[value[0]];
  const subject = group?.values.find((one) => one.value === value[1])?.subject ?? "";
  return tip(subject, [{ colour: color, text: `${group?.name ?? ""}: ${figures(value[1])} ${unit}` }]);
}
