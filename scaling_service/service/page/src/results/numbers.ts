/** Every number that a method fitted; what muscles differ in; settings and files that the result rests on. */

import type { ComparisonDocument, FittedParameter, MuscleDocument } from "../api/schema.ts";
import { bullets, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { number, signed, words } from "../ui/words.ts";

/** Unit of a parameter to the unit shown, the factor, and the digits. */
const SHOWN = { m: ["mm", 1e3, 1], rad: ["deg", 180 / Math.PI, 1], "1": ["", 1, 3] } as const;

export function numbers(document: ComparisonDocument, place: HTMLElement): void {
  const rows = Object.values(document.methods).flatMap(({ method, parameters }) => parameters.map((one) => row(method, one)));
  if (rows.length === 0) place.append(h("p", null, "No method fitted any number."));
  else {
    place.append(table({
      caption: "Fitted numbers",
      name: "fitted",
      columns: ["method", "number", "value", "SD", "unit", "determined", "at a bound"].map((title) => ({ title })),
      rows,
      filter: true,
      note: "Not determined: the recordings say less about it than the first guess, or it belongs to a combination that changes nothing in the markers. Such numbers mean little alone.",
    }));
  }
  if (document.muscles != null) place.append(h("h2", null, "Muscles"), ...muscles(document.muscles));
  place.append(h("h2", null, "Where this comes from"), ...origins(document));
}

function row(method: string, { name, value, unit, sd, identifiable, at_bound }: FittedParameter): Cell[] {
  const [shown, factor, digits] = SHOWN[unit];
  return [cell(method), cell(name), cell(number(factor * value, digits), factor * value), sd === null ? cell("not known", null) : cell(number(factor * sd, digits), factor * sd),
    cell(shown), cell(identifiable ? "yes" : "no", undefined, identifiable ? "good" : "poor"), cell(at_bound ? "yes" : "no", undefined, at_bound ? "poor" : undefined)];
}

function muscles({ summary, notes, reference, trials, differences }: MuscleDocument): HTMLElement[] {
  return [
    bullets([...summary, ...notes.map(sentence)]),
    table({
      caption: `Largest differences from ${reference}, over ${trials.join(", ")}`,
      name: "muscles",
      columns: ["of", "method", "muscle", "coordinate", "difference", reference, "RMS", "unit", "at, deg", "where"].map((title) => ({ title })),
      rows: differences.map((one) => [cell(one.quantity), cell(one.method), cell(one.muscle), cell(words(one.coordinate)), cell(signed(one.difference), one.difference),
        cell(number(one.reference), one.reference), cell(number(one.rms), one.rms), cell(one.unit), cell(number(one.angle_deg, 0), one.angle_deg), cell(`${one.trial}, ${number(one.time_s, 2)} s`)]),
      filter: true,
    }),
  ];
}

function origins({ settings, seed, code_version, input_hashes, methods }: ComparisonDocument): HTMLElement[] {
  return [
    folded("Settings", table({
      caption: "Settings as resolved",
      name: "settings",
      columns: [{ title: "setting" }, { title: "value", words: true }],
      rows: [...flat(settings), ["seed", String(seed)], ["version", code_version]].map(([name = "", value = ""]) => [cell(name), cell(value)]),
      filter: true,
    })),
    folded("Input files", table({
      caption: "SHA-256 of each file",
      name: "inputs",
      columns: [{ title: "file" }, { title: "SHA-256", words: true }],
      rows: Object.entries(input_hashes).map(([name, sha]) => [cell(name), cell(sha)]),
    })),
    folded("Computing time", table({
      caption: "Iterations and seconds",
      name: "time",
      columns: ["method", "iterations", "fitting, s", "following, s"].map((title) => ({ title })),
      rows: Object.values(methods).map((one) => [cell(one.method), cell(String(one.iterations), one.iterations), cell(number(one.wall_s.calibration, 2), one.wall_s.calibration),
        cell(number(one.wall_s.inverse_kinematics, 2), one.wall_s.inverse_kinematics)]),
    })),
  ];
}

/** Settings within settings by their names with points between. */
function flat(settings: object, above = ""): string[][] {
  return Object.entries(settings).flatMap(([name, value]) =>
    (typeof value === "object" && value !== null && !Array.isArray(value) ? flat(value as object, `${above}${name}.`) : [[`${above}${name}`, JSON.stringify(value)]]));
}
