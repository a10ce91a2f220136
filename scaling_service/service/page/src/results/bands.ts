/** Coordinates and conventional angles of one model over time, each within what it is known to. */

import { receive } from "../api/http.ts";
import { filePath } from "../api/jobs.ts";
import type { MotionDocument } from "../api/schema.ts";
import { figure, Joined } from "../charts/figure.ts";
import { drawLines, stops, type Curve } from "../charts/lines.ts";
import { link } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { styleOf } from "../ui/palette.ts";
import { words } from "../ui/words.ts";
import type { Finished } from "./result.ts";

const NORMAL_95 = 1.96;
const HEIGHT = 230;

/** Column to its values; the first is the time. */
type Columns = Map<string, number[]>;

interface Known {
  title: string;
  name: string;
  unit: string;
  y: number[];
  sd: number[];
  range?: readonly [number, number] | undefined;
}

export async function bands(document: MotionDocument, { job, place: at, signal }: Finished, place: HTMLElement): Promise<void> {
  const names = Object.keys(document.trials);
  const trial = at.query.get("over") ?? names[0] ?? "";
  const files = [`${trial}_ik.mot`, `${trial}_ik_sd.mot`, `${trial}_clinical.csv`].map((name) =>
    document.files.includes(name) ? read(filePath(job.id, name), signal) : new Map<string, number[]>());
  const [motion, spread, clinical] = (await Promise.all(files)) as [Columns, Columns, Columns];
  if (signal.aborted) return;
  place.append(
    h("div", { class: "bar" }, select("Over time", names.map((value) => ({ value, text: value })), trial, (over) => void (location.hash = link(at.parts, { over })))),
    h("p", { class: "quiet" }, "Bands: where the true value lies in 95 of 100 frames, by the cameras' noise and by skin that moves over the bone. An error of the model's joints is not in them. Dashed and grey: a joint stands at the end of the model's range, which decides there."),
  );
  const groups = [["Angles of the conventional gait model", conventional(clinical), clinical], ["Coordinates of the model", coordinates(document, motion, spread), motion]] as const;
  const joined = new Joined();
  for (const [title, all, source] of groups) {
    if (all.length > 0) place.append(h("h2", null, title), h("div", { class: "grid" }, ...all.map((one) => drawn(trial, source.get("time") ?? source.get("time_s") ?? [], one, joined, signal))));
  }
}

function coordinates({ units, locked, ranges }: MotionDocument, motion: Columns, spread: Columns): Known[] {
  return Object.entries(units).flatMap(([name, unit]) => {
    const [y, sd] = [motion.get(name), spread.get(name)];
    return y === undefined || sd === undefined || locked.includes(name) ? [] : [{ title: words(name), name, unit, y, sd, range: ranges?.[name] as [number, number] | undefined }];
  });
}

function conventional(clinical: Columns): Known[] {
  return [...clinical].flatMap(([column, y]) => {
    const name = column.replace(/_deg$/, "");
    const sd = clinical.get(`${name}_sd_deg`);
    return sd === undefined ? [] : [{ title: words(name), name, unit: "deg", y, sd }];
  });
}

function drawn(trial: string, x: number[], { title, name, unit, y, sd, range }: Known, joined: Joined, signal: AbortSignal): HTMLElement {
  const curves: Curve[] = [{ name: title, style: styleOf("MB_am"), y, half: sd.map((one) => NORMAL_95 * one) }];
  return figure({
    title,
    name: `${trial}_${name}_${unit}`,
    alt: `${title} over time in ${trial}, ${unit}, with its 95 % band.`,
    zoom: true,
    joined,
    height: HEIGHT,
    drawing: (ink) => drawLines(ink, { x, unit, xAxis: { name: "time, s" }, yAxis: { name: unit }, curves, ...stops(x, curves, range) }),
    rows: () => [["time_s", unit, `sd_${unit}`], ...x.map((time, k) => [time, y[k], sd[k]])],
  }, signal).element;
}

/** A table of numbers: OpenSim's with its header, or comma-separated. */
async function read(path: string, signal: AbortSignal): Promise<Columns> {
  const lines = (await receive(path, { signal }, (answer) => answer.text())).trim().split(/\r?\n/);
  const cells = (line: string): string[] => line.split(/,|\t/);
  const head = cells(lines[lines.indexOf("endheader") + 1] ?? "");
  const rows = lines.slice(lines.indexOf("endheader") + 2).map((line) => cells(line).map((cell) => (cell === "" ? NaN : Number(cell))));
  return new Map(head.map((name, k) => [name, rows.map((row) => row[k] ?? NaN)]));
}
