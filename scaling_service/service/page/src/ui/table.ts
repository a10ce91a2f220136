/** Tables: sorted by a click on a header, filtered by a word, saved as CSV. */

import { fill, h } from "./dom.ts";
import { METHODS } from "./glossary.ts";
import { csv, saveText } from "./save.ts";

export type Tone = "good" | "fair" | "poor" | "unknown";

export interface Cell {
  text: string;
  /** What it is sorted by and what stands in the CSV; the text unless given. */
  value?: string | number | null | undefined;
  tone?: Tone | undefined;
  node?: Node | undefined;
  hint?: string | undefined;
}

export interface Column {
  title: string;
  colour?: string;
  words?: boolean;
}

export interface TableOptions {
  caption: string;
  /** Of the file that the table is saved as. */
  name: string;
  columns: Column[];
  /** The first cell of each row is its header. */
  rows: Cell[][];
  note?: string;
  filter?: boolean;
  sorted?: { column: number; down: boolean };
}

export const cell = (text: string, value?: Cell["value"], tone?: Tone): Cell => ({ text, value, tone });

export function table(options: TableOptions): HTMLElement {
  const state = { column: options.sorted?.column ?? -1, down: options.sorted?.down ?? false, word: "" };
  const body = h("tbody");
  const heads = options.columns.map((column, place) => head(column, () => sortBy(place)));
  const many = h("span", { class: "quiet", role: "status" });

  function sortBy(place: number): void {
    state.down = state.column === place ? !state.down : false;
    state.column = place;
    show();
  }

  function show(): void {
    const rows = ordered(options.rows.filter((row) => matches(row, state.word)), state.column, state.down);
    fill(body, ...rows.map((row) => rowOf(row, options.columns)));
    heads.forEach((element, place) => mark(element, place === state.column, state.down));
    many.textContent = state.word === "" ? "" : `${rows.length} of ${options.rows.length}`;
  }

  show();
  return h(
    "div",
    { class: "tabular" },
    h("div", { class: "bar" }, h("p", { class: "caption" }, options.caption), h("span", { class: "tools" }, ...tools(options, state, show, many))),
    h(
      "div",
      { class: "table", tabindex: 0, role: "region", "aria-label": options.caption },
      h("table", null, h("thead", null, h("tr", null, ...heads)), body),
    ),
    options.note !== undefined && h("p", { class: "note" }, options.note),
  );
}

function tools(
  options: TableOptions,
  state: { word: string },
  show: () => void,
  many: HTMLElement,
): (HTMLElement | false)[] {
  const input: HTMLInputElement = h("input", {
    type: "search",
    placeholder: "filter",
    "aria-label": `Filter: ${options.caption}`,
    oninput: () => {
      state.word = input.value.trim().toLowerCase();
      show();
    },
  });
  const asCsv = h("button", { class: "small", onclick: () => saveText(`${options.name}.csv`, textOf(options)) }, "CSV");
  asCsv.setAttribute("aria-label", `Save as CSV: ${options.caption}`);
  return [many, options.filter === true && input, asCsv];
}

function head(column: Column, sort: () => void): HTMLElement {
  if (column.title === "") return h("th", { scope: "col" }, h("span", { class: "sr" }, "what it is or does"));
  const chip = column.colour === undefined ? false : chipOf(column.colour);
  return h(
    "th",
    { scope: "col", class: column.words === true ? "words" : null },
    h("button", { class: "head", title: METHODS[column.title] ?? null, onclick: sort }, chip, column.title),
  );
}

/** A small square of a colour. */
export function chipOf(colour: string): HTMLElement {
  const chip = h("span", { class: "chip", "aria-hidden": "true" });
  chip.style.background = colour;
  return chip;
}

function mark(element: HTMLElement, chosen: boolean, down: boolean): void {
  if (chosen) element.setAttribute("aria-sort", down ? "descending" : "ascending");
  else element.removeAttribute("aria-sort");
}

function rowOf(row: Cell[], columns: Column[]): HTMLElement {
  const [first, ...rest] = row;
  return h(
    "tr",
    null,
    h("th", { scope: "row" }, first?.node ?? first?.text),
    ...rest.map((one, place) =>
      h(
        "td",
        { class: [one.tone && `tone ${one.tone}`, columns[place + 1]?.words && "words"].filter(Boolean).join(" "), title: one.hint },
        one.node ?? one.text,
      ),
    ),
  );
}

function matches(row: Cell[], word: string): boolean {
  return word === "" || row.some((one) => one.text.toLowerCase().includes(word));
}

function ordered(rows: Cell[][], column: number, down: boolean): Cell[][] {
  if (column < 0) return rows;
  const sign = down ? -1 : 1;
  return [...rows].sort((a, b) => sign * compared(valueOf(a[column]), valueOf(b[column])));
}

function compared(a: string | number | null, b: string | number | null): number {
  if (a === null || b === null) return a === b ? 0 : a === null ? 1 : -1;
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a).localeCompare(String(b), undefined, { numeric: true });
}

const valueOf = (found: Cell | undefined): string | number | null =>
  found === undefined ? null : found.value === undefined ? found.text : found.value;

function textOf(options: TableOptions): string {
  const title = options.columns.map((column) => column.title);
  return csv([title, ...options.rows.map((row) => row.map(valueOf))]);
}
