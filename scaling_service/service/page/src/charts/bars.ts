/** Ranked bars, one for each name, with a mark on each such as its floor. */

import { figures } from "../ui/words.ts";
import { base, nameAxis, valueAxis } from "./base.ts";
import type { Option } from "./engine.ts";
import { tip } from "./figure.ts";
import type { Ink } from "./ink.ts";

const LEFT = 110;

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
  left?: number;
}

export function barsOption(ink: Ink, { bars, axis, unit, marks, left }: Bars): Option {
  const common = base(ink, { left: left ?? LEFT });
  return {
    ...common,
    tooltip: {
      ...(common.tooltip as object),
      trigger: "axis",
      axisPointer: { type: "none" },
      formatter: (found: unknown) => describe(bars, unit, marks, found),
    },
    xAxis: valueAxis(ink, { name: axis, min: 0 }, "x"),
    yAxis: nameAxis(ink, bars.map((bar) => bar.name), (left ?? LEFT) - 10),
    series: [
      {
        type: "bar",
        barMaxWidth: 16,
        data: bars.map((bar) => ({ value: bar.value, itemStyle: { color: bar.colour } })),
      },
      {
        type: "scatter",
        symbol: "rect",
        symbolSize: [3, 14],
        itemStyle: { color: ink.text },
        data: bars.flatMap((bar, place) => (bar.mark === null || bar.mark === undefined ? [] : [[bar.mark, place]])),
      },
    ],
  };
}

export const barsHeight = (count: number): number => Math.max(150, 70 + 20 * count);

function describe(bars: readonly Bar[], unit: string, marks: string | undefined, found: unknown): HTMLElement {
  const bar = bars[(found as { dataIndex: number }[])[0]?.dataIndex ?? 0];
  if (bar === undefined) return tip("", []);
  const rows = [{ colour: bar.colour, text: `${figures(bar.value)} ${unit}` }];
  if (marks !== undefined && typeof bar.mark === "number") {
    rows.push({ colour: "currentColor", text: `${marks}: ${figures(bar.mark)} ${unit}` });
  }
  return tip(bar.name, rows);
}
