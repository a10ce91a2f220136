/** The parts of ECharts that the page uses, and nothing else, so that the bundle stays small.
 *
 * ECharts draws one and the same description to a canvas, which is fast, and to SVG, which is what a figure
 * is saved as; libraries that only know a canvas cannot give the latter.
 */

import { BarChart, CustomChart, HeatmapChart, LineChart, ScatterChart } from "echarts/charts";
import {
  DataZoomInsideComponent,
  DataZoomSliderComponent,
  GridComponent,
  MarkAreaComponent,
  MarkLineComponent,
  TooltipComponent,
  VisualMapComponent,
} from "echarts/components";
import { init, use, type ECharts, type EChartsCoreOption } from "echarts/core";
import { CanvasRenderer, SVGRenderer } from "echarts/renderers";

use([
  BarChart,
  CanvasRenderer,
  CustomChart,
  DataZoomInsideComponent,
  DataZoomSliderComponent,
  GridComponent,
  HeatmapChart,
  LineChart,
  MarkAreaComponent,
  MarkLineComponent,
  ScatterChart,
  SVGRenderer,
  TooltipComponent,
  VisualMapComponent,
]);

export type Chart = ECharts;
export type Option = EChartsCoreOption;

export const onCanvas = (place: HTMLElement, option: Option): Chart => {
  const chart = init(place, null, { renderer: "canvas" });
  chart.setOption(option);
  return chart;
};

/** The text of an SVG document. */
export function asSvg(option: Option, width: number, height: number): string {
  const chart = init(null, null, { renderer: "svg", ssr: true, width, height });
  chart.setOption(option);
  const text = chart.renderToSVGString();
  chart.dispose();
  return text;
}
