/** A figure: its title, its drawing, and its being saved as SVG, PNG and, where it has rows, CSV. */

import type { Clicked } from "plotly.js-cartesian-dist-min";
import { part } from "../api/connection.ts";
import { note, parsed } from "../routes.ts";
import { h } from "../ui/dom.ts";
import { csv, save, saveText } from "../ui/save.ts";
import { onTheme, theme } from "../ui/theme.ts";
import type { Drawing } from "./base.ts";
import { inkOf, type Ink } from "./ink.ts";

type Engine = typeof import("./engine.ts");

/** A place once it was drawn into. */
interface PlotElement {
  on: ((event: "plotly_unhover", listener: () => void) => void) & ((event: "plotly_click" | "plotly_hover", listener: (clicked: Clicked) => void) => void) &
    ((event: "plotly_relayout", listener: (changed: Record<string, unknown>) => void) => void);
}

export type Row = (string | number | null | undefined)[];

/** Figures over the same x: what one is pointed at, those that are seen show, too. */
export class Joined {
  private readonly all = new Map<HTMLElement, Engine>();

  /** @param told called with the x that is pointed at. */
  constructor(private readonly told: (x: number) => void = () => undefined) {}

  join(plot: HTMLElement, engine: Engine): void {
    this.all.set(plot, engine);
    const drawn = plot as unknown as PlotElement;
    drawn.on("plotly_hover", ({ xvals }) => {
      const [x = null] = xvals ?? [];
      this.point(plot, x);
      if (x !== null) this.told(x);
    });
    drawn.on("plotly_unhover", () => this.point(plot, null));
  }

  private point(from: HTMLElement, x: number | null): void {
    for (const [plot, engine] of this.all) {
      const { top, bottom } = plot.getBoundingClientRect();
      if (plot !== from && plot.isConnected && bottom > 0 && top < innerHeight) engine.point(plot, x);
    }
  }
}

export interface FigureOptions {
  title: string;
  /** Of the files that it is saved as. */
  name: string;
  /** What it shows, for those who do not see it. */
  alt: string;
  height: number;
  drawing: (ink: Ink) => Drawing;
  rows?: () => Row[];
  note?: string;
  /** Whether it can be made larger, to look at a stretch of its x axis. */
  zoom?: boolean;
  /** What a click at a place of a drawing in rows and columns does. */
  clicked?: (row: number, column: number) => void;
  /** What pointing at such a place does. */
  pointed?: (row: number, column: number) => void;
  /** With which others it is pointed at. */
  joined?: Joined;
}

export interface Drawn {
  element: HTMLElement;
  /** Draw again what has changed. */
  redraw: () => void;
}

/** Figures are drawn when they come near to what is seen or nothing else is to be done, and let go with the signal. */
export function figure(options: FigureOptions, signal: AbortSignal): Drawn {
  const plot = h("div", { class: "plot", role: "img", "aria-label": options.alt });
  plot.style.height = `${options.height}px`;
  let engine: Engine | null = null;
  let stretch = options.zoom === true ? stretchOf(options.name) : null;
  let large = false;

  const present = (): Drawing => (large ? zoomed(options.drawing(inkOf(theme())), stretch) : options.drawing(inkOf(theme())));
  /** Keep the stretch in the address, so that it can be sent. */
  const keep = (changed: Record<string, unknown>): void => {
    const whole = changed["xaxis.range"] as unknown[] | undefined; // by the slider; a drag tells its ends apart
    const [low, high] = whole ?? [changed["xaxis.range[0]"], changed["xaxis.range[1]"]];
    if (typeof low === "number" && typeof high === "number") stretch = [low, high];
    else if (changed["xaxis.autorange"] === true) stretch = null;
    else return;
    note({ zoom: stretch === null ? null : [options.name, ...stretch.map((one) => one.toPrecision(5))].join(SEPARATOR) });
  };
  const redraw = (): void => void engine?.draw(plot, present());
  const enlarge = (): void => {
    large = !large;
    if (!large && stretch !== null) {
      stretch = null;
      note({ zoom: null });
    }
    element.classList.toggle("large", large);
    larger.setAttribute("aria-pressed", String(large));
    plot.style.height = `${large ? 2 * options.height : options.height}px`;
    redraw();
  };
  const larger = h("button", { class: "small", "aria-pressed": "false", "aria-label": `Larger: ${options.title}`, onclick: enlarge }, "Larger");
  const begin = async (): Promise<void> => {
    if (engine !== null) return;
    const found = await part(() => import("./engine.ts"));
    if (signal.aborted || engine !== null) return;
    engine = found;
    await found.draw(plot, present());
    if (signal.aborted) return found.purge(plot);
    if (options.zoom === true) (plot as unknown as PlotElement).on("plotly_relayout", (changed) => large && keep(changed));
    listen(plot, "plotly_click", options.clicked);
    listen(plot, "plotly_hover", options.pointed);
    options.joined?.join(plot, found);
    onTheme(redraw, signal);
    const resizing = new ResizeObserver(() => found.resize(plot));
    resizing.observe(plot);
    signal.addEventListener("abort", () => {
      resizing.disconnect();
      found.purge(plot);
    });
  };
  whenNear(plot, () => void begin(), signal);
  const element = h(
    "figure",
    null,
    h("div", { class: "bar" }, h("figcaption", null, options.title), h("span", { class: "tools" }, options.zoom === true && larger, saving(options, () => plot.clientWidth))),
    plot,
    options.note !== undefined && h("p", { class: "note" }, options.note),
  );
  if (stretch !== null) enlarge();
  return { element, redraw };
}

/** Chosen: nobody prints sooner. */
const LATER_MS = 100;

function whenNear(element: Element, work: () => void, signal: AbortSignal): void {
  const watching = new IntersectionObserver(
    (seen) => {
      if (!seen.some((one) => one.isIntersecting)) return;
      watching.disconnect();
      work();
    },
    { rootMargin: "300px" },
  );
  watching.observe(element);
  const draw = (): void => {
    if (signal.aborted) return;
    if (!element.isConnected) return void setTimeout(() => idle(draw), LATER_MS); // the page waits for results beside it
    watching.disconnect();
    work();
  };
  idle(draw);
  signal.addEventListener("abort", () => watching.disconnect());
}

const waiting: (() => void)[] = [];

/** Do a piece of work when nothing else is to be done, one after the other: whoever prints sees all figures. */
function idle(work: () => void): void {
  waiting.push(work);
  if (waiting.length === 1) next();
}

function next(): void {
  requestIdleCallback(() => {
    waiting[0]?.();
    waiting.shift();
    if (waiting.length > 0) next();
  });
}

/** With a slider for the stretch of x that is shown; a drag across the drawing does the same, a double click undoes it. */
const zoomed = ({ data, layout }: Drawing, range: Stretch | null): Drawing => ({
  data,
  layout: {
    ...layout,
    dragmode: "zoom",
    xaxis: { ...(layout["xaxis"] as object), fixedrange: false, rangeslider: { thickness: 0.12 }, ...(range === null ? {} : { range }) },
  },
});

type Stretch = [number, number];

const SEPARATOR = "~";

/** The stretch of a figure's x axis that the address names: `zoom=NAME~FROM~TO`. */
function stretchOf(name: string): Stretch | null {
  const [figure, from, to] = (parsed(location.hash).query.get("zoom") ?? "").split(SEPARATOR);
  const [low, high] = [Number(from), Number(to)];
  return figure === name && low < high ? [low, high] : null;
}

function listen(plot: HTMLElement, event: "plotly_click" | "plotly_hover", told: FigureOptions["clicked"]): void {
  (plot as unknown as PlotElement).on(event, ({ points }) => {
    const [row, column] = [points[0]?.pointNumber ?? []].flat();
    if (row !== undefined && column !== undefined) told?.(row, column);
  });
}

/** One menu of all that a figure can be saved as. */
function saving(options: FigureOptions, width: () => number): HTMLElement {
  const { rows } = options;
  const button = (format: string, work: () => void): HTMLElement =>
    h("button", { class: "small", "aria-label": `Save as ${format}: ${options.title}`, onclick: () => {
      menu.open = false;
      work();
    } }, format);
  const found = [
    button("SVG", () => void asSvgText(options, width()).then((text) => saveText(`${options.name}.svg`, text, "image/svg+xml"))),
    button("PNG", () => void asPngBlob(options, width()).then((content) => save(`${options.name}.png`, content))),
  ];
  if (rows !== undefined) found.push(button("CSV", () => saveText(`${options.name}.csv`, csv(rows()))));
  const menu: HTMLDetailsElement = h("details", { class: "menu", onfocusout: ({ relatedTarget }) => {
    if (!menu.contains(relatedTarget as Node | null)) menu.open = false;
  } }, h("summary", { class: "button small", "aria-label": `Save: ${options.title}` }, "Save"), h("div", null, ...found));
  return menu;
}

/** Saved figures are light, whatever the page is: they go into papers. */
async function asSvgText({ drawing, height }: FigureOptions, width: number): Promise<string> {
  const { asSvg } = await part(() => import("./engine.ts"));
  return asSvg(drawing(inkOf("light")), width, height);
}

async function asPngBlob({ drawing, height }: FigureOptions, width: number): Promise<Blob> {
  const { asPng } = await part(() => import("./engine.ts"));
  const bytes = Uint8Array.from(atob(await asPng(drawing(inkOf("light")), width, height)), (one) => one.charCodeAt(0));
  return new Blob([bytes], { type: "image/png" });
}
