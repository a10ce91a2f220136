/** Segment lengths, joint centres, knee axes and marker shifts of all methods, with differences and intervals. */

import type { ComparisonDocument, MethodResult } from "../api/schema.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { number, signed, words } from "../ui/words.ts";
import { union } from "./result.ts";
import { methodColumns } from "./verdict.ts";

const NORMAL_95 = 1.96;
const DEGREES = 180 / Math.PI;
const TRUTH = "truth";

export function sizes(document: ComparisonDocument, place: HTMLElement): void {
  const names = Object.keys(document.methods);
  const references = document.truth === null ? names : [TRUTH, ...names];
  const tables = h("div");
  const show = (reference: string): void => fill(tables, ...tablesOf(document, reference));
  const first = document.truth === null ? (names.includes("EB") ? "EB" : (names[0] ?? "")) : TRUTH;
  place.append(
    h("div", { class: "bar" }, select("Differences from", references.map((value) => ({ value, text: value })), first, show)),
    tables,
  );
  show(first);
}

function tablesOf(document: ComparisonDocument, reference: string): HTMLElement[] {
  const methods = Object.values(document.methods);
  const of = reference === TRUTH ? null : (document.methods[reference] ?? null);
  return [
    lengths(methods, of?.segment_lengths_mm ?? document.truth?.segment_lengths_mm ?? {}, reference),
    axes(methods, of, reference),
    centres(methods, of, reference),
    shifts(methods),
  ];
}

/** A value with the half width of its interval, and its difference from the reference. */
function compared(value: number | undefined, half: number | null, reference: number | undefined, digits = 1): Cell {
  if (value === undefined) return cell("–", null);
  const parts = [h("span", null, number(value, digits))];
  if (half !== null) parts.push(h("span", { class: "quiet" }, ` ± ${number(half, digits)}`));
  if (reference !== undefined) parts.push(h("span", { class: "difference" }, signed(value - reference, digits)));
  return { text: number(value, digits), value, node: h("span", null, ...parts) };
}

function lengths(methods: MethodResult[], reference: Record<string, number>, name: string): HTMLElement {
  const rows = union(methods.map((method) => method.segment_lengths_mm)).map((segment) => [
    cell(words(segment)),
    ...methods.map((method) => compared(method.segment_lengths_mm[segment], lengthInterval(method, segment), reference[segment])),
  ]);
  return table({
    caption: "Segment lengths, mm",
    name: "segment_lengths_mm",
    columns: [{ title: "segment" }, ...methodColumns(methods.map((method) => method.method))],
    rows,
    note: `In each cell: the length, ± half its 95 % interval by the errors of markers and sizes or of the fit, and its difference from ${name}. Errors that all trials share, such as a misplaced marker, are not in the interval.`,
  });
}

export const lengthInterval = (method: MethodResult, segment: string): number | null =>
  method.length_estimates?.[segment] !== undefined ? NORMAL_95 * method.length_estimates[segment].sd_mm :
  scaledInterval(method, segment === "inter_hip" ? "pelvis" : segment.replace("shank", "tibia"), method.segment_lengths_mm[segment]);

/** Half the interval of what grows with the factor of its segment, and is as uncertain; null where no factor was fitted. */
function scaledInterval(method: MethodResult, segment: string, size: number | undefined): number | null {
  const factor = method.parameters.find(({ name }) => name === `scale.${segment}`);
  if (factor?.sd === null || factor?.sd === undefined || size === undefined) return null;
  return (NORMAL_95 * factor.sd * Math.abs(size)) / factor.value;
}

function axes(methods: MethodResult[], reference: MethodResult | null, name: string): HTMLElement {
  const rows = union(methods.map((method) => method.knee_axis_deg)).flatMap((side) =>
    (["x", "y"] as const).map((axis) => [
      cell(`${side === "r" ? "right" : side === "l" ? "left" : side} knee, about ${axis}`),
      ...methods.map((method) => {
        const sd = method.parameters.find((one) => one.name === `axis.knee_${side}.${axis}`)?.sd ?? null;
        const half = sd === null ? null : NORMAL_95 * sd * DEGREES;
        return compared(method.knee_axis_deg[side]?.[axis], half, reference?.knee_axis_deg[side]?.[axis]);
      }),
    ]),
  );
  return table({
    caption: "Turns of the knee axes about x (forward) and y (up) of the thigh, deg",
    name: "knee_axes_deg",
    columns: [{ title: "axis" }, ...methodColumns(methods.map((method) => method.method))],
    rows,
    note: `Differences from ${name} where it has axes.`,
  });
}

function centres(methods: MethodResult[], reference: MethodResult | null, name: string): HTMLElement {
  const rows = union(methods.map((method) => method.joint_centres_mm)).flatMap((joint) =>
    ["x", "y", "z"].map((axis, k) => [
      cell(`${words(joint)}, ${axis}`),
      cell(methods[0]?.joint_centres_mm[joint]?.frame ?? ""),
      ...methods.map((method) => {
        const centre = method.joint_centres_mm[joint];
        const sd = centre?.sd_mm?.[k];
        const half = centre === undefined ? null : sd === undefined ? scaledInterval(method, centre.frame, centre.xyz[k]) : 1.96 * sd;
        return compared(centre?.xyz[k], half, reference?.joint_centres_mm[joint]?.xyz[k]);
      }),
    ]),
  );
  return table({
    caption: "Joint centres in the frame of the proximal segment, mm",
    name: "joint_centres_mm",
    columns: [{ title: "centre" }, { title: "frame" }, ...methodColumns(methods.map((method) => method.method))],
    rows,
    filter: true,
    note: `x forward, y up, z to the right. ± half the 95 % interval where it is known. Differences from ${name} where it has centres.`,
  });
}

function shifts(methods: MethodResult[]): HTMLElement {
  const rows = union(methods.map((method) => method.marker_shift_mm)).map((marker) => [
    cell(marker),
    ...methods.map((method) => cell(number(method.marker_shift_mm[marker]), method.marker_shift_mm[marker] ?? null)),
  ]);
  return table({
    caption: "How far each marker was moved on its segment, mm",
    name: "marker_shift_mm",
    columns: [{ title: "marker" }, ...methodColumns(methods.map((method) => method.method))],
    rows,
    filter: true,
  });
}
