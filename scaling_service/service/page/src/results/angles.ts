/** Joint angles of all methods: over the gait cycle with their spread and where they differ, or over time. */

import { vocabulary } from "../api/vocabulary.ts";
import type { ClinicalDocument, ComparisonDocument, CoordinateEntry, CycleScene, GaitScene, SceneDocument, SceneTrial } from "../api/schema.ts";
import { figure, Joined } from "../charts/figure.ts";
import { drawLines, stops, type Curve } from "../charts/lines.ts";
import { link } from "../routes.ts";
import { Companion } from "../scene/companion.ts";
import { Frames } from "../scene/frames.ts";
import { pathIn, sceneOf } from "../scene/scene.ts";
import { box, group, select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { guarded } from "../ui/problem.ts";
import { cell, chipOf, table } from "../ui/table.ts";
import { chance, number, plural, withChance, words } from "../ui/words.ts";
import { clinical } from "./clinical.ts";
import type { Finished } from "./result.ts";

const CYCLE = "gait cycle";
const CLINIC = "clinic";
const HEIGHT = 230;

export async function angles(document: ComparisonDocument, { job, place: at, signal }: Finished, place: HTMLElement): Promise<void> {
  const [scene, { gait_angles }] = await Promise.all([sceneOf(job.id), vocabulary()]);
  if (signal.aborted) return;
  const methods = scene.bodies.map(({ name }) => name);
  const shown = new Set(methods);
  const hasCycles = scene.gait !== null && Object.keys(scene.gait.angles).length > 0;
  const read = clinicalOf(document);
  const { verdict } = document;
  const chosen = at.query.get("over") ?? (hasCycles ? CYCLE : read !== null ? CLINIC : (scene.trials.at(-1)?.name ?? ""));
  const options = [...(read !== null ? [{ value: CLINIC, text: "as a clinic reads them" }] : []), ...(hasCycles ? [{ value: CYCLE, text: "per cent of the gait cycle" }] : []),
    ...scene.trials.map(({ name }) => ({ value: name, text: `time, ${name}` }))];
  const drawings = h("div");
  const failed = h("div");
  const known = styles(methods);
  let drawn = new AbortController();
  const draw = (): void =>
    void guarded(failed, async () => {
      drawn.abort();
      drawn = new AbortController();
      const present = AbortSignal.any([signal, drawn.signal]);
      const wanted = methods.filter((name) => shown.has(name));
      fill(drawings, chosen === CLINIC && read !== null ? clinical(read.method, read.found, gait_angles, HEIGHT, present) : chosen === CYCLE && scene.gait !== null ? cycles(scene.gait, wanted, present) : await overTime(scene, chosen, wanted, verdict?.method, job.id, present));
    });
  place.append(
    h("div", { class: "bar" },
      select("Over", options, chosen, (over) => void (location.hash = link(at.parts, { over }))),
      chosen === CLINIC ? "" : group("Methods", ...methods.map((name) => box(h("span", null, chipOf(known.get(name)?.colour ?? ""), ` ${name}`), true, (wanted) => {
        if (wanted) shown.add(name);
        else shown.delete(name);
        draw();
      })))),
    scene.gait !== null && scene.gait.reason !== "" ? h("p", { class: "quiet" }, `No gait cycles: ${scene.gait.reason}.`) : "",
    failed,
    drawings,
  );
  draw();
}

/** What a clinic reads of the model that the verdict says to use. */
function clinicalOf({ verdict, methods }: ComparisonDocument): { method: string; found: ClinicalDocument } | null {
  const method = verdict?.method ?? Object.keys(methods)[0] ?? "";
  const found = methods[method]?.clinical ?? null;
  return found === null || Object.keys(found.sides).length === 0 ? null : { method, found };
}

function cycles(gait: GaitScene, methods: readonly string[], signal: AbortSignal): HTMLElement {
  const known = styles(methods);
  const x = Array.from({ length: 101 }, (_, k) => k);
  const all = Object.entries(gait.angles);
  const joined = new Joined();
  const figures = all.map(([name, cycle]) => {
    const curves = methods.flatMap((method): Curve[] => {
      const style = known.get(method);
      const y = cycle.mean_deg[method];
      return y === undefined || style === undefined ? [] : [{ name: method, style, y, half: cycle.sd_deg[method] }];
    });
    return figure({
      title: `${words(name)} (${tested(cycle)})`,
      name: `cycle_${name}_deg`,
      alt: `${words(name)} over the gait cycle, mean and standard deviation of ${cycle.cycles} cycles by ${methods.join(", ")}. ${whereInWords(cycle)}`,
      zoom: true,
      joined,
      height: HEIGHT,
      drawing: (ink) => drawLines(ink, { x, curves, unit: "deg", marked: cycle.differ_percent,
        xAxis: { name: "gait cycle, %", range: [0, 100] }, yAxis: { name: "deg" } }),
      rows: () => [["percent", ...curves.flatMap((one) => [`${one.name}_mean_deg`, `${one.name}_sd_deg`])],
        ...x.map((percent) => [percent, ...curves.flatMap((one) => [one.y[percent], one.half?.[percent]])])],
    }, signal).element;
  });
  return h(
    "div",
    null,
    h("p", { class: "quiet" }, `Mean ± SD over the cycles of ${gait.trials.join(", ")}${gait.held_out ? ", which were not fitted" : ""}. ` +
      "Grey: where the methods differ by an analysis of variance along the curve (permutation of statistical parametric maps, 5 %)."),
    h("div", { class: "grid" }, ...figures),
    pairTable(gait),
  );
}

const tested = (cycle: CycleScene): string =>
  `${plural(cycle.cycles, "cycle")}, ${cycle.can_decide ? withChance(cycle.p) : "too few to test"}`;

function whereInWords({ differ_percent }: CycleScene): string {
  if (differ_percent.length === 0) return "The methods do not differ significantly anywhere.";
  return `The methods differ ${differ_percent.map(([from, to]) => `from ${from} to ${to} %`).join(", ")}.`;
}

function pairTable(gait: GaitScene): HTMLElement {
  const tests = Object.values(gait.angles).flatMap(({ pairs }) => Object.values(pairs));
  if (!tests.some(({ can_decide }) => can_decide)) {
    return h("p", { class: "quiet" }, `Too few cycles to test each method against ${gait.reference}: record more strides.`);
  }
  const rows = Object.entries(gait.angles).flatMap(([name, cycle]) =>
    Object.entries(cycle.pairs).map(([method, test]) => [
      cell(words(name)),
      cell(`${method} and ${gait.reference}`),
      test.can_decide ? cell(chance(test.p), test.p) : cell("too few cycles", null),
      cell(test.differ_percent.map(([from, to]) => `${from} to ${to} %`).join(", ") || "–"),
    ]),
  );
  return table({
    caption: `Each method against ${gait.reference}`,
    name: "angle_pairs",
    columns: [{ title: "angle" }, { title: "methods", words: true }, { title: "p" }, { title: "differ", words: true }],
    rows,
    filter: true,
  });
}

/** The same in words. */
const atStop = ({ levels = [] }: ReturnType<typeof stops>): string => levels.map(({ y }) => ` Stands at its stop, ${number(y)}, at times.`).join("");

async function overTime(
  scene: SceneDocument,
  name: string,
  methods: readonly string[],
  preferred: string | undefined,
  job: string,
  signal: AbortSignal,
): Promise<HTMLElement> {
  const trial = scene.trials.find((one) => one.name === name);
  if (trial === undefined) return h("p", null, `There is no recording ${name}.`);
  const found = await Promise.all(methods.filter((method) => method in trial.motions).map((method) => valuesOf(trial, method, job, signal)));
  const coordinates = [...new Set(found.flatMap(({ coordinates: all }) => all.map((one) => one.name)))];
  const followed = found.map(({ method }) => method);
  const method = followed.find((one) => one === preferred) ?? followed[0];
  if (method === undefined) return h("p", { class: "quiet" }, `No method that is chosen followed ${name}.`);
  const companion = new Companion(scene, trial, method, pathIn(job), signal);
  const joined = new Joined((time) => companion.look(time));
  void companion.begin(trial.start_s + trial.frames / trial.rate_hz / 2);
  return h("div", { class: "accompanied" }, companion.element,
    h("div", { class: "grid" }, ...coordinates.map((coordinate) => timeFigure(trial, coordinate, found, joined, signal))));
}

interface Values {
  method: string;
  coordinates: CoordinateEntry[];
  values: Float32Array;
  step: number;
}

async function valuesOf(trial: SceneTrial, method: string, job: string, signal: AbortSignal): Promise<Values> {
  const motion = trial.motions[method];
  if (motion === undefined) return { method, coordinates: [], values: new Float32Array(), step: 1 };
  const whole = await new Frames(motion.angles, pathIn(job), signal, () => undefined).whole();
  return { method, coordinates: motion.coordinates, ...whole };
}

function timeFigure(trial: SceneTrial, coordinate: string, found: readonly Values[], joined: Joined, signal: AbortSignal): HTMLElement {
  const known = styles(found.map(({ method }) => method));
  const { unit = "", range } = found.flatMap(({ coordinates }) => coordinates).find(({ name }) => name === coordinate) ?? {};
  const step = found[0]?.step ?? 1;
  const curves = found.flatMap(({ method, coordinates, values }): Curve[] => {
    const column = coordinates.findIndex(({ name }) => name === coordinate);
    const style = known.get(method);
    if (column < 0 || style === undefined) return [];
    const y = Float32Array.from({ length: values.length / coordinates.length }, (_, row) => values[row * coordinates.length + column] ?? NaN);
    return [{ name: method, style, y }];
  });
  const x = Float64Array.from({ length: curves[0]?.y.length ?? 0 }, (_, k) => trial.start_s + (k * step) / trial.rate_hz);
  const ends = stops(x, curves, range);
  return figure({
    title: words(coordinate),
    name: `${trial.name}_${coordinate}_${unit}`,
    alt: `${words(coordinate)} over time in ${trial.name} by ${curves.map((one) => one.name).join(", ")}, ${unit}.${atStop(ends)}`,
    zoom: true,
    joined,
    height: HEIGHT,
    drawing: (ink) => drawLines(ink, { x, curves, unit, ...ends, xAxis: { name: "time, s" }, yAxis: { name: unit } }),
    rows: () => [["time_s", ...curves.map((one) => `${one.name}_${unit}`)], ...Array.from(x, (time, k) => [time, ...curves.map((one) => one.y[k])])],
  }, signal).element;
}
