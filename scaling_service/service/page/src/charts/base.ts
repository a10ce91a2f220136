/** What all figures have in common. */

import type { Option } from "./engine.ts";
import { minus } from "../ui/words.ts";
import { FONT, type Ink } from "./ink.ts";

export interface Axis {
  name: string;
  min?: number | "dataMin";
  max?: number | "dataMax";
}

/** Room around the drawing, letters, no movement, a quiet tooltip. */
export function base(ink: Ink, margins: { left?: number; right?: number; top?: number; bottom?: number } = {}): Option {
  return {
    animation: false,
    textStyle: { fontFamily: FONT, color: ink.text, fontSize: 12 },
    grid: { left: 52, right: 14, top: 12, bottom: 40, containLabel: false, ...margins },
    tooltip: {
      confine: true,
      backgroundColor: ink.paper,
      borderColor: ink.line,
      textStyle: { color: ink.text, fontFamily: FONT, fontSize: 12 },
      axisPointer: { lineStyle: { color: ink.quiet }, label: { show: false } },
    },
  };
}

export function valueAxis(ink: Ink, { name, min, max }: Axis, where: "x" | "y"): Option {
  return {
    type: "value",
    name,
    nameLocation: "middle",
    nameGap: where === "x" ? 24 : 38,
    nameTextStyle: { color: ink.quiet },
    axisLabel: { color: ink.quiet, hideOverlap: true, formatter: (value: number) => minus(String(Number(value.toPrecision(12)))) },
    axisLine: { show: where === "x", lineStyle: { color: ink.quiet } },
    splitLine: { show: where === "y", lineStyle: { color: ink.line } },
    scale: min === undefined,
    ...(min === undefined ? {} : { min }),
    ...(max === undefined ? {} : { max }),
  };
}

export function nameAxis(ink: Ink, names: readonly string[], width: number): Option {
  return {
    type: "category",
    data: names.map((value) => ({ value })),
    inverse: true,
    axisLabel: { color: ink.text, fontSize: 11, width, overflow: "truncate", interval: names.length > 45 ? "auto" : 0 },
    axisLine: { lineStyle: { color: ink.quiet } },
    axisTick: { show: false },
  };
}
