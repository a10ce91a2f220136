/** A paper's study done again: its claims, its tables, its figures. */

import { getJson } from "../api/http.ts";
import { getResult } from "../api/jobs.ts";
import type { StatisticsDocument } from "../api/schema.ts";
import { drawDots } from "../charts/dots.ts";
import { figure } from "../charts/figure.ts";
import { drawIntervals } from "../charts/intervals.ts";
import { bullets, callout } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { FLOOR, styles } from "../ui/palette.ts";
import { cell, table, type Tone } from "../ui/table.ts";
import { figures, number, words } from "../ui/words.ts";
import { agreement } from "./agreement.ts";
import { cohortAngles } from "./cohortangles.ts";
import { quantities } from "./quantities.ts";
import { parts, type Part, type ResultView } from "./result.ts";

/** As Python writes it, in `scaling_service/report/summary.py`. */
interface Summary {
  headline: string;
  tone: Tone | "plain";
  why: string[];
  tables: { caption: string; columns: string[]; rows: [string, Tone | "plain"][][]; note: string; words: boolean }[];
}

interface Beside { quantity: string; method: string; paper_mean: number | null; paper_sd: number | null; mean: number; sd: number }
interface Person { name: string; slopes_per_cm?: number[]; dr?: number[]; total?: number[]; true_measurement_error?: number[]; fitted?: Record<string, { wrench_rmse: number[] }> }
interface Study {
  length_difference_mm?: Beside[];
  kinematic_error_mm?: Beside[];
  statistics?: StatisticsDocument;
  walkers_statistics?: StatisticsDocument;
  persons?: Person[];
}

const COMPONENTS = ["fx", "fy", "fz", "mx", "my", "mz"];
const SHARES = [["dr", "residual", "#1f6fb2"], ["total", "uncertainty", FLOOR], ["true_measurement_error", "true error", "#D55E00"]] as const;
const WRENCH = ["fx, N", "fy, N", "mz, N m"];
const WAYS: Record<string, string> = { classical: "#0072B2", consistent: "#D55E00", predicted: "#009E73" };

export const study: ResultView = async (found) => {
  const { signal, job } = found;
  const [document, { headline, tone, why, tables: [claims, ...tables] }] = await Promise.all([getResult<Study>(job.id, signal), getJson<Summary>(`/v1/jobs/${job.id}/summary`, signal)]);
  const drawn = figuresOf(document, signal);
  const { statistics, walkers_statistics: walkers } = document;
  await parts("Parts of the study", found, [
    { name: "claims", title: "Claims", show: (place) => place.append(callout(headline, tone, bullets(why)), ...(claims === undefined ? [] : [shown(claims, 0)])) },
    { name: "tables", title: "Tables", show: (place) => place.append(...tables.map(shown)) },
    ...(drawn.length > 0 ? [{ name: "figures", title: "Figures", show: (place: HTMLElement) => place.append(h("div", { class: "grid" }, ...drawn)) }] : []),
    ...(walkers === undefined ? [] : [{ name: "angles", title: "Figure 6: angles", show: (place: HTMLElement) => cohortAngles(walkers.joint_angles, signal, place) }]),
    ...(statistics === undefined ? [] : statisticsParts(statistics, signal)),
  ]);
};

function statisticsParts(found: StatisticsDocument, signal: AbortSignal): Part[] {
  return [
    { name: "errors", title: "Errors", show: (place) => quantities(found, ["kinematic_error_mm"], signal, place) },
    { name: "sizes", title: "Sizes", show: (place) => quantities(found, ["segment_lengths_mm", "knee_axis_deg", "marker_shift_mm", "from_truth_mm", "from_truth_deg"], signal, place) },
    { name: "agreement", title: "Agreement", show: (place) => agreement(found, signal, place) },
  ];
}

function shown({ caption, columns, rows, note, words: wordy }: Summary["tables"][number], place: number): HTMLElement {
  return table({
    caption,
    name: `table_${place + 1}`,
    columns: columns.map((title) => ({ title, words: wordy })),
    rows: rows.map((row) => row.map(([text, tone]) => cell(text, undefined, tone === "plain" ? undefined : tone))),
    note,
    filter: rows.length > 12,
  });
}

function figuresOf({ length_difference_mm: lengths, kinematic_error_mm: errors, persons = [] }: Study, signal: AbortSignal): HTMLElement[] {
  return [
    ...(lengths === undefined ? [] : [beside("Figure 4: length minus that of EB, mm", lengths, signal)]),
    ...(errors === undefined ? [] : [beside("Figure 5: kinematic error, mm", errors, signal)]),
    ...(persons.some((one) => one.slopes_per_cm !== undefined) ? [slopes(persons, signal), ...COMPONENTS.map((name, k) => shares(name, k, persons, signal))] : []),
    ...(persons.some((one) => one.fitted !== undefined) ? WRENCH.map((name, k) => ways(name, k, persons, signal)) : []),
  ];
}

/** The paper's means in grey, ours in the method's colour, each with its SD. */
function beside(title: string, cells: readonly Beside[], signal: AbortSignal): HTMLElement {
  const known = styles([...new Set(cells.map(({ method }) => method))]);
  const many = new Set(cells.map(({ quantity }) => quantity)).size > 1;
  const intervals = cells.flatMap(({ quantity, method, paper_mean, paper_sd, mean, sd }) => {
    const name = many ? `${words(quantity)} ${method}` : method;
    const ours = { name, low: mean - sd, middle: mean, high: mean + sd, colour: known.get(method)?.colour ?? "" };
    return paper_mean === null ? [ours] : [ours, { name: "paper", low: paper_mean - (paper_sd ?? 0), middle: paper_mean, high: paper_mean + (paper_sd ?? 0), colour: FLOOR }];
  });
  return figure({
    title,
    name: title.slice(0, 8).replace(" ", "_"),
    alt: intervals.map(({ name, middle, high }) => `${name} ${number(middle)} ± ${number(high - middle)}`).join("; "),
    height: 70 + 18 * intervals.length,
    drawing: (ink) => drawIntervals(ink, intervals, "mm, mean ± SD; grey: the paper", 130),
    rows: () => [["name", "mean", "sd"], ...intervals.map((one) => [one.name, one.middle, one.high - one.middle])],
  }, signal).element;
}

interface Group { name: string; colour: string; values: number[] }

/** A dot for each person. */
function dots(title: string, unit: string, persons: readonly Person[], groups: readonly Group[], signal: AbortSignal, logarithmic = false): HTMLElement {
  const drawn = groups.map(({ name, colour, values }) => ({
    name, colour, mean: values.reduce((sum, value) => sum + value, 0) / values.length,
    values: values.map((value, k) => ({ subject: persons[k]?.name ?? "", value })) }));
  return figure({
    title,
    name: title.replaceAll(/[^A-Za-z0-9]+/g, "_"),
    alt: `A dot for each person: ${drawn.map(({ name, mean }) => `${name} ${figures(mean)} ${unit} on average`).join(", ")}.`,
    height: 260,
    drawing: (ink) => drawDots(ink, drawn, unit, logarithmic),
    rows: () => [["person", ...groups.map(({ name }) => name)], ...persons.map((person, k) => [person.name, ...groups.map(({ values }) => values[k])])],
  }, signal).element;
}

const slopes = (persons: readonly Person[], signal: AbortSignal): HTMLElement =>
  dots("Figures 7 and 8: growth of the dispersion with the added error", "1/cm", persons,
    COMPONENTS.map((name, k) => ({ name, colour: "#0072B2", values: persons.map((one) => one.slopes_per_cm?.[k] ?? NaN) })), signal);

const shares = (name: string, k: number, persons: readonly Person[], signal: AbortSignal): HTMLElement =>
  dots(`Figure 10, ${name}: residual, uncertainty, true error`, "share of weight", persons,
    SHARES.map(([key, title, colour]) => ({ name: title, colour, values: persons.map((one) => one[key]?.[k] ?? NaN) })), signal, true);

const ways = (name: string, k: number, persons: readonly Person[], signal: AbortSignal): HTMLElement =>
  dots(`RMS error of ${name}`, name.split(", ")[1] ?? "", persons,
    Object.entries(WAYS).map(([way, colour]) => ({ name: way, colour, values: persons.map((one) => one.fitted?.[way]?.wrench_rmse[k] ?? NaN) })), signal);
