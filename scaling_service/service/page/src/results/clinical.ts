/** Conventional angles over the gait cycle, left and right, within what is usual. */

import type { ClinicalDocument, ClinicalSide, GaitAngleWord } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawLines, type Curve } from "../charts/lines.ts";
import { bullets } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { FLOOR, type Style } from "../ui/palette.ts";
import { cell, table } from "../ui/table.ts";
import { number, plural } from "../ui/words.ts";

/** As gait laboratories draw them, left in red; colours of Okabe & Ito 2008. */
const SIDES: Record<string, { side: string; style: Style }> = {
  l: { side: "left", style: { colour: "#D55E00", dash: "dash" } },
  r: { side: "right", style: { colour: "#0072B2", dash: "solid" } },
};
const USUAL: Style = { colour: FLOOR, dash: "solid" };
const X = Array.from({ length: 101 }, (_, k) => k);

export function clinical(method: string, document: ClinicalDocument, angles: readonly GaitAngleWord[], height: number, signal: AbortSignal): HTMLElement {
  const { sides, gps_deg, reference, reference_gps_deg, population, held_out } = document;
  const cycles = Object.entries(SIDES).flatMap(([key, { side }]) => (sides[key] === undefined ? [] : [`${side}: ${plural(sides[key].cycles.length, "cycle")}`]));
  const several = Object.values(sides).some(({ cycles: all }) => all.length > 1);
  const drawn = angles.flatMap((angle) => {
    const curves = Object.entries(SIDES).flatMap(([key, { side, style }]) => curveOf(sides[key], angle.name, side, style));
    return curves.length === 0 ? [] : [drawing(angle, [...usual(angle), ...curves], height, signal)];
  });
  return h("div", null,
    h("p", { class: "quiet" }, `${several ? "Mean ± SD" : "Angles"} of ${method} (${cycles.join(", ")}; ${held_out ? "held out" : "used to fit"}). Dashed red: left, blue: right. Grey: mean ± SD of ${population} (${reference}).`),
    gps_deg === null ? "" : h("p", null, h("b", null, `Gait Profile Score ${number(gps_deg)}°`), `, against ${number(reference_gps_deg)}° of that population's own members.`),
    h("div", { class: "grid" }, ...drawn),
    scores(document, angles),
    bullets([...document.doubtful, ...document.left_out]));
}

function curveOf(of: ClinicalSide | undefined, angle: string, name: string, style: Style): Curve[] {
  const found = of?.curves[angle];
  return found === undefined ? [] : [{ name, style, y: X.map(between(found.mean_deg)), half: found.sd_deg === null ? undefined : X.map(between(found.sd_deg)) }];
}

function usual({ usual_deg, usual_sd_deg }: GaitAngleWord): Curve[] {
  return usual_deg === null || usual_sd_deg === null ? [] : [{ name: "usual", style: USUAL, y: X.map(between(usual_deg)), half: X.map(between(usual_sd_deg)) }];
}

/** Values at even steps, as a function of the per cent of the cycle. */
const between = (values: readonly number[]) => (percent: number): number => {
  const place = (percent / 100) * (values.length - 1);
  const [low, share] = [Math.floor(place), place % 1];
  return (values[low] ?? NaN) * (1 - share) + (share === 0 ? 0 : (values[low + 1] ?? NaN) * share);
};

function drawing({ name, title, negative, positive }: GaitAngleWord, curves: Curve[], height: number, signal: AbortSignal): HTMLElement {
  return figure({
    title: `${title}, deg: ${positive} +, ${negative} −`,
    name: `clinical_${name}_deg`,
    alt: `${title} over the gait cycle, ${positive} positive, by ${curves.map((one) => one.name).join(", ")}.`,
    zoom: true,
    height,
    drawing: (ink) => drawLines(ink, { x: X, curves, unit: "deg", xAxis: { name: "gait cycle, %", range: [0, 100] }, yAxis: { name: "deg" } }),
    rows: () => [["percent", ...curves.flatMap((one) => [`${one.name}_mean_deg`, `${one.name}_sd_deg`])],
      ...X.map((percent) => [percent, ...curves.flatMap((one) => [one.y[percent], one.half?.[percent]])])],
  }, signal).element;
}

/** How far each angle of each leg is from what is usual, over the cycle. */
function scores({ sides, reference_gvs_deg }: ClinicalDocument, angles: readonly GaitAngleWord[]): HTMLElement {
  const known = angles.filter(({ name }) => name in reference_gvs_deg);
  const legs = Object.entries(SIDES).filter(([key]) => sides[key] !== undefined);
  return table({
    caption: "Gait variable scores: RMS distance from the mean of that population, deg",
    name: "gait_scores_deg",
    columns: [{ title: "angle" }, ...legs.map(([, { side }]) => ({ title: side })), { title: "its own members" }],
    rows: known.map(({ name, title }) => [cell(title), ...legs.map(([key]) => cell(number(sides[key]?.gvs_deg[name]), sides[key]?.gvs_deg[name] ?? null)),
      cell(number(reference_gvs_deg[name]), reference_gvs_deg[name])]),
    note: "Baker et al. 2009.",
  });
}
