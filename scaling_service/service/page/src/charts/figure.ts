/** A figure: its title, its drawing, and its being saved as SVG, PNG and, where it has rows, CSV. */

import { part } from "../api/connection.ts";
import { fill, h } from "../ui/dom.ts";
import { csv, save, saveText } from "../ui/save.ts";
import { onTheme, theme } from "../ui/theme.ts";
import type { Chart, Option } from "./engine.ts";
import { inkOf, type Ink } from "./ink.ts";

export type Row = (string | number | null | undefined)[];

export interface FigureOptions {
  title: string;
  /** Of the files that it is saved as. */
  name: string;
  /** What it shows, for those who do not see it. */
  alt: string;
  height: number;
  option: (ink: Ink) => Option;
  rows?: () => Row[];
  note?: string;
  /** Whether it can be made larger, to look at a stretch of its x axis. */
  zoom?: boolean;
  drawn?: (chart: Chart) => void;
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
  let chart: Chart | null = null;
  let large = false;

  const option = (): Option => (large ? zoomed(options.option(inkOf(theme())), inkOf(theme())) : options.option(inkOf(theme())));
  const redraw = (): void => chart?.setOption(option(), { notMerge: true });
  const enlarge = (): void => {
    large = !large;
    element.classList.toggle("large", large);
    larger.setAttribute("aria-pressed", String(large));
    plot.style.height = `${large ? 2 * options.height : options.height}px`;
    redraw();
  };
  const larger = h("button", { class: "small", "aria-pressed": "false", "aria-label": `Larger: ${options.title}`, onclick: enlarge }, "Larger");
  const draw = async (): Promise<void> => {
    const { onCanvas } = await part(() => import("./engine.ts"));
    if (signal.aborted || chart !== null) return;
    chart = onCanvas(plot, option());
    options.drawn?.(chart);
    onTheme(redraw, signal);
    const resizing = new ResizeObserver(() => chart?.resize());
    resizing.observe(plot);
    signal.addEventListener("abort", () => {
      resizing.disconnect();
      chart?.dispose();
    });
  };
  whenNear(plot, () => void draw(), signal);
  const element = h(
    "figure",
    null,
    h("div", { class: "bar" }, h("figcaption", null, options.title), h("span", { class: "tools" }, options.zoom === true && larger, saving(options, () => plot.clientWidth))),
    plot,
    options.note !== undefined && h("p", { class: "note" }, options.note),
  );
  return { element, redraw };
}

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
  idle(() => {
    if (signal.aborted || !element.isConnected) return;
    watching.disconnect();
    work();
  });
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

/** With a slider for the stretch of x that is shown; a pinch, or the wheel with Ctrl, does the same. */
function zoomed(option: Option, ink: Ink): Option {
  const slider = { type: "slider", height: 22, bottom: 6, borderColor: ink.line, textStyle: { color: ink.quiet }, labelFormatter: "" };
  return { ...option, grid: { ...(option["grid"] as object), bottom: 78 }, dataZoom: [slider, { type: "inside", zoomOnMouseWheel: "ctrl" }] };
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
    button("PNG", () => void asPng(options, width()).then((content) => save(`${options.name}.png`, content))),
  ];
  if (rows !== undefined) found.push(button("CSV", () => saveText(`${options.name}.csv`, csv(rows()))));
  const menu: HTMLDetailsElement = h("details", { class: "menu", onfocusout: ({ relatedTarget }) => {
    if (!menu.contains(relatedTarget as Node | null)) menu.open = false;
  } }, h("summary", { class: "button small", "aria-label": `Save: ${options.title}` }, "Save"), h("div", null, ...found));
  return menu;
}

/** Saved figures are light, whatever the page is: they go into papers. */
async function asSvgText(options: FigureOptions, width: number): Promise<string> {
  const { asSvg } = await part(() => import("./engine.ts"));
  const ink = inkOf("light");
  return asSvg({ ...options.option(ink), backgroundColor: ink.paper }, width, options.height);
}

const PNG_SCALE = 3;

async function asPng(options: FigureOptions, width: number): Promise<Blob> {
  const place = h("div", { class: "sr" });
  place.style.width = `${width}px`;
  place.style.height = `${options.height}px`;
  document.body.append(place);
  try {
    const { onCanvas } = await part(() => import("./engine.ts"));
    const ink = inkOf("light");
    const chart = onCanvas(place, options.option(ink));
    const address = chart.getDataURL({ type: "png", pixelRatio: PNG_SCALE, backgroundColor: ink.paper });
    chart.dispose();
    return blobOf(address);
  } finally {
    place.remove();
  }
}

function blobOf(address: string): Blob {
  const bytes = Uint8Array.from(atob(address.slice(address.indexOf(",") + 1)), (one) => one.charCodeAt(0));
  return new Blob([bytes], { type: "image/png" });
}

/** Lines of what a pointer is at; names only ever go in as text. */
export function tip(title: string, lines: readonly { colour: string; text: string }[]): HTMLElement {
  const content = h("div", { class: "tip" });
  fill(
    content,
    h("b", null, title),
    ...lines.map(({ colour, text }) => {
      const chip = h("span", { class: "chip" });
      chip.style.background = colour;
      return h("div", null, chip, text);
    }),
  );
  return content;
}
