/** Colours: of each method one and one kind of line, and those of the page. */

import methods from "./methods.json";

export interface Style {
  colour: string;
  dash: "solid" | "dash" | "dot" | "dashdot";
}

const KNOWN = methods.known as Record<string, Style>;
const OTHERS = methods.others as Style[];

/** The style of each name; those that are not known take what colours are left, in turn. */
export function styles(names: readonly string[]): Map<string, Style> {
  const others = names.filter((name) => !(name in KNOWN));
  return new Map(
    names.map((name) => [name, KNOWN[name] ?? (OTHERS[others.indexOf(name) % OTHERS.length] as Style)]),
  );
}

export const styleOf = (name: string, among: readonly string[] = [name]): Style =>
  styles(among).get(name) ?? (OTHERS[0] as Style);

/** From nothing to much: lightness changes all the way, so that it reads in grey, too. */
export const HEAT_LIGHT = ["#ffffff", "#fde3a7", "#e08214", "#7f2704"];
export const HEAT_DARK = ["#101418", "#4a2c12", "#c06a10", "#fde3a7"];

/** Of the story of a search: before, after, what noise leaves, what a black box reaches. */
export const BEFORE = "#996633";
export const AFTER = "#0072B2";
export const FLOOR = "#8492a0";
export const CEILING = "#009E73";
export const TRIED = "#CC79A7";

export const MEASURED_LIGHT = "#1f2933";
export const MEASURED_DARK = "#f5f7fa";
export const BONE = "#d9c9a8";
