/** What methods differ in for the muscles: in words, over time, and as a table. */

import { getJson } from "../api/http.ts";
import { filePath } from "../api/jobs.ts";
import { Problem } from "../api/problem.ts";
import type { MuscleCurve, MuscleDocument, MuscleScene } from "../api/schema.ts";
import { figure } from "../charts/figure.ts";
import { drawLines, type Curve } from "../charts/lines.ts";
import { Frames } from "../scene/frames.ts";
import { pathIn } from "../scene/scene.ts";
import { bullets } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { number, signed, words } from "../ui/words.ts";

export async function muscles(document: MuscleDocument, job: string, signal: AbortSignal, place: HTMLElement): Promise<void> {
  const { summary, notes, reference, trials, differences } = document;
  const drawn = await curves(job, signal);
  if (signal.aborted) return;
  place.append(
    bullets([...summary, ...notes.map(sentence)]),
    drawn,
    table({
      caption: `Largest differences from ${reference}, over ${trials.join(", ")}`,
      name: "muscles",
      columns: ["of", "method", "muscle", "coordinate", "difference", reference, "RMS", "unit", "at, deg", "where"].map((title) => ({ title })),
      rows: differences.map((one) => [cell(one.quantity), cell(one.method), cell(one.muscle), cell(words(one.coordinate)), cell(signed(one.difference), one.difference),
        cell(number(one.reference), one.reference), cell(number(one.rms), one.rms), cell(one.unit), cell(number(one.angle_deg, 0), one.angle_deg), cell(`${one.trial}, ${number(one.time_s, 2)} s`)]),
      filter: true,
    }));
}

async function curves(job: string, signal: AbortSignal): Promise<HTMLElement> {
  const found = await getJson<MuscleScene>(filePath(job, "scene/muscles.json"), signal).catch((error: unknown) => {
    if (error instanceof Problem && error.status === 404) return null; // made by an older version
    throw error;
  });
  return h("div", { class: "grid" }, ...(await Promise.all((found?.curves ?? []).map((curve) => drawing(curve, job, signal)))));
}

async function drawing({ quantity, muscle, coordinate, trial, unit, start_s, rate_hz, methods, values: stored }: MuscleCurve, job: string, signal: AbortSignal): Promise<HTMLElement> {
  const { values, step } = await new Frames(stored, pathIn(job), signal, () => undefined).whole();
  const known = styles(methods);
  const x = Float64Array.from({ length: values.length / methods.length }, (_, k) => start_s + (k * step) / rate_hz);
  const all = methods.flatMap((name, k): Curve[] => {
    const style = known.get(name);
    return style === undefined ? [] : [{ name, style, y: Float32Array.from(x, (_, row) => values[methods.length * row + k] ?? NaN) }];
  });
  const title = `${quantity}: ${[muscle, words(coordinate)].filter((one) => one !== "").join(", ")}, ${unit}`;
  return figure({
    title,
    name: `muscle_${quantity}_${muscle}_${coordinate}`.replaceAll(" ", "_"),
    alt: `${title} over time in ${trial} by ${methods.join(", ")}.`,
    zoom: true,
    height: 220,
    drawing: (ink) => drawLines(ink, { x, curves: all, unit, xAxis: { name: `time in ${trial}, s` }, yAxis: { name: unit } }),
    rows: () => [["time_s", ...methods], ...Array.from(x, (time, row) => [time, ...all.map(({ y }) => y[row])])],
  }, signal).element;
}
