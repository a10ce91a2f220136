/** Playing one recording back: the stage, the controls, and the map of the error below. */

import type { SceneDocument, SceneTrial } from "../api/schema.ts";
import { note } from "../routes.ts";
import { Player } from "../space/player.ts";
import { NEWTON_PER_METRE } from "../space/ground.ts";
import { FAR_MM, Theatre } from "../space/theatre.ts";
import { box, group, select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { guarded, problemBox } from "../ui/problem.ts";
import { save } from "../ui/save.ts";
import { cell, chipOf, table } from "../ui/table.ts";
import { number, words } from "../ui/words.ts";
import { away, farthest, quoted } from "./farthest.ts";
import { Frames } from "./frames.ts";
import { errorMap, type ErrorMap } from "./heatmap.ts";

export interface PlaybackOptions {
  scene: SceneDocument;
  trial: SceneTrial;
  path: (file: string) => string;
  /** Bodies that are shown at first; the first of them has the map of its error. */
  shown: readonly string[];
  frame: number;
  signal: AbortSignal;
  /** What puts a marker right, given the time that is shown; nothing where nothing can be asked for. */
  mend?: ((marker: string, now: () => number) => HTMLElement | null) | undefined;
  /** Whether the maps of all bodies stand below each other in the same colours, the first body's. */
  together?: boolean;
}

/** Film a canvas until what is returned is called, which gives the video. */
function filmed(canvas: HTMLCanvasElement): () => Promise<Blob> {
  const recorder = new MediaRecorder(canvas.captureStream(), { mimeType: "video/webm" });
  const parts: Blob[] = [];
  recorder.ondataavailable = ({ data }) => void parts.push(data);
  recorder.start(1000);
  return () => new Promise((resolve) => {
    recorder.onstop = () => resolve(new Blob(parts, { type: "video/webm" }));
    recorder.stop();
  });
}

/** Chosen: people read no faster. */
const LIGHT_MS = 100;

/** Scroll a row into what is seen of its table, and nothing else. */
function show(row: HTMLElement | null): void {
  const seen = row?.closest(".table");
  if (row === null || seen == null || row.matches(":hover")) return;
  const hidden = row.offsetTop < seen.scrollTop + row.offsetHeight || row.offsetTop + row.offsetHeight > seen.scrollTop + seen.clientHeight;
  if (hidden) seen.scrollTop = row.offsetTop - seen.clientHeight / 2;
}

export class Playback {
  readonly element = h("div", { class: "playback" });
  private readonly player: Player;
  private readonly status = h("p", { class: "status", role: "status" });
  /** Unlike the status, not read out: it changes with every frame. */
  private readonly passing = h("p", { class: "status" });
  private readonly apart = h("p", { class: "quiet" });
  private readonly map = h("div");
  private readonly list = h("div");
  private readonly mend = h("div");
  private readonly failed = h("div");
  private theatre: Theatre | null = null;
  private cursors: ErrorMap[] = [];
  private errors: Frames | null = null;
  private method: string;
  /** The marker that was clicked, and the one that is pointed at. */
  private marker: string | null = null;
  private pointed: string | null = null;
  private rows = new Map<string, { head: HTMLElement; now: HTMLElement }>();

  constructor(private readonly options: PlaybackOptions) {
    const { trial, shown, signal } = options;
    const [first = ""] = Object.keys(trial.motions);
    this.method = options.together === true ? first : (shown[0] ?? first);
    this.player = new Player(trial.frames, trial.rate_hz, trial.start_s, (frame) => this.show(frame), () => this.theatre?.stage, signal);
    this.element.append(this.failed);
  }

  async begin(): Promise<void> {
    const { trial, scene, path, shown, frame, signal } = this.options;
    const colours = styles(scene.bodies.map(({ name }) => name));
    const bodies = scene.bodies.flatMap((entry) => {
      const motion = trial.motions[entry.name];
      return motion === undefined ? [] : [{ entry, poses: motion.poses, placed: motion.placed, colour: colours.get(entry.name)?.colour ?? "" }];
    });
    try {
      this.theatre = new Theatre({ ...trial, bodies }, path, `Models of ${bodies.map(({ entry }) => entry.name).join(", ")} in ${trial.name}`, signal);
    } catch {
      this.element.append(problemBox({ problem: "This browser cannot draw in space (WebGL is missing)", remedy: "Use another browser; the numbers below are all there" }, "warning"));
    }
    const { theatre } = this;
    if (theatre !== null) {
      theatre.picked = (label) => this.choose(label);
      theatre.pointed = (label) => this.point(label);
      theatre.compared = (names, differences) => {
        const told = differences.map(({ name, mm }) => `${words(name)} ${number(mm, 0)} mm`).join("; ");
        this.apart.textContent = differences.length === 0 ? "" : `Joint centres of ${names.map(quoted).join(" and ")} apart, lit from ${FAR_MM} mm on: ${told}`;
      };
      const controls = h("div", { class: "controls" });
      this.element.append(controls, h("div", { class: "watched" }, theatre.stage.element, this.list), this.player.element, this.status, this.passing, this.mend, this.apart);
      this.element.addEventListener("keydown", (event) => this.key(event));
      await theatre.begin(shown.filter((name) => name in trial.motions), frame);
      fill(controls, ...this.choices(theatre, bodies.map(({ entry }) => entry.name)));
    }
    this.player.go(frame);
    this.element.append(this.options.together === true ? "" : this.mapChoice(), this.map, theatre === null ? this.list : "");
    await this.draw();
  }

  private show(frame: number): void {
    this.theatre?.showNow(frame);
    for (const map of this.cursors) map.at(frame);
    this.tell(frame);
    clearTimeout(this.noting);
    this.noting = window.setTimeout(() => {
      if (!this.options.signal.aborted) note({ trial: this.options.trial.name, frame: String(frame) });
    }, 400);
  }

  private noting = 0;
  /** Brings the table up to date; not with every picture, which it would hold up. */
  private light: () => void = () => undefined;
  private lighting = 0;

  private choose(marker: string | null): void {
    this.marker = marker;
    fill(this.mend, marker !== null && this.options.mend?.(marker, () => this.player.time));
    this.tell(this.player.frame);
  }

  /** Light a marker while something points at it, be it in the picture, in the map or in the table. */
  private point(marker: string | null, frame?: number): void {
    this.pointed = marker;
    if (frame === undefined || !this.player.look(frame)) this.tell(this.player.frame);
  }

  /** What is known of the marker that is pointed at or chosen, else of the farthest, which is lit. */
  private tell(frame: number): void {
    const errors = this.errors?.at(frame) ?? null;
    const { labels } = this.options.trial;
    const marker = this.pointed ?? this.marker ?? farthest(labels, errors);
    this.theatre?.pick(marker);
    this.light = () => this.rows.forEach(({ head, now }, label) => {
      now.textContent = number(errors?.[labels.indexOf(label)]);
      const row = head.closest("tr");
      row?.classList.toggle("lit", label === marker);
      if (label === marker && this.marker === null) show(row);
    });
    if (this.lighting === 0) this.lighting = window.setTimeout(() => {
      this.lighting = 0;
      this.light();
    }, LIGHT_MS);
    const far = away(labels, errors, marker, this.method);
    this.status.textContent = this.marker === null || marker !== this.marker ? "" : `${marker}: ${far}`;
    this.passing.textContent = marker === null || marker === this.marker ? "" : `${marker === this.pointed ? "Pointed at" : "Farthest now"}: ${marker}, ${far}`;
  }

  private choices(theatre: Theatre, names: readonly string[]): HTMLElement[] {
    const known = styles(names);
    const models = names.map((name) =>
      box(h("span", null, chipOf(known.get(name)?.colour ?? ""), ` ${name}`), this.options.shown.includes(name), (shown) =>
        void guarded(this.failed, () => theatre.showBody(name, shown))));
    return [
      group("Models", ...models),
      group("Show",
        box("bones", true, (shown) => theatre.showBones(shown)),
        box("model markers", true, (shown) => theatre.showMarkers(shown)),
        box(h("span", { class: "measured" }, "measured markers"), true, (shown) => theatre.showMeasured(shown)),
        box("names", false, (shown) => theatre.showNames(shown)),
        box("follow", theatre.following, (following) => {
          theatre.following = following;
        })),
      this.options.trial.plates.length > 0 && h("span", { class: "quiet" }, `Force arrows: 1 m is ${NEWTON_PER_METRE} N`),
      h("button", { class: "small", "aria-label": "Save the view as PNG", onclick: () => void this.snapshot(theatre) }, "PNG"),
      this.videoButton(theatre),
    ].filter((one) => one !== false);
  }

  private async snapshot(theatre: Theatre): Promise<void> {
    const picture = await theatre.stage.picture();
    if (picture !== null) save(`${this.options.trial.name}_${this.player.frame}.png`, picture);
  }

  /** Plays once from the beginning and saves what is seen. */
  private videoButton(theatre: Theatre): HTMLElement {
    const button: HTMLButtonElement = h("button", { class: "small", "aria-label": "Save a video as WebM", onclick: () =>
      void guarded(this.failed, async () => {
        button.disabled = true;
        button.textContent = "Recording …";
        try {
          const stop = filmed(theatre.stage.canvas);
          await this.player.through();
          save(`${this.options.trial.name}.webm`, await stop());
        } finally {
          button.disabled = false;
          button.textContent = "WebM";
        }
      }) }, "WebM");
    return button;
  }

  private mapChoice(): HTMLElement {
    const names = Object.keys(this.options.trial.motions).map((value) => ({ value, text: value }));
    return h("div", { class: "bar" }, select("Error of", names, this.method, (value) => {
      this.method = value;
      void this.draw();
    }));
  }

  private async draw(): Promise<void> {
    const { trial, path, signal } = this.options;
    await guarded(this.failed, async () => {
      const go = (frame: number, marker: string): void => {
        this.choose(marker);
        this.player.step(frame - this.player.frame);
      };
      const maps: ErrorMap[] = [];
      for (const method of this.options.together === true ? Object.keys(trial.motions) : [this.method]) maps.push(await errorMap(trial, method, path, signal, go, (frame, marker) => this.point(marker, frame), maps[0]?.top));
      this.cursors = maps;
      const motion = trial.motions[this.method];
      this.errors = motion === undefined ? null : new Frames(motion.errors, path, signal, () => this.tell(this.player.frame));
      await this.errors?.begin();
      this.tell(this.player.frame);
      fill(this.map, ...maps.map(({ element }) => element));
      fill(this.list, this.markerTable(maps[0]?.rms ?? [], go));
      this.tell(this.player.frame);
      for (const map of maps) map.at(this.player.frame);
    });
  }

  /** All markers with their error now and over the recording; pointing at one lights it in the picture. */
  private markerTable(rms: readonly number[], go: (frame: number, marker: string) => void): HTMLElement {
    this.rows = new Map(this.options.trial.labels.map((label, k) => [label, {
      // One stop for the keyboard; from there the arrows go on.
      head: h("button", { class: "linked", tabindex: k === 0 ? 0 : -1, onclick: () => go(this.player.frame, label),
        onpointerenter: () => this.point(label), onpointerleave: () => this.point(null), onfocus: () => this.point(label), onblur: () => this.point(null),
        onkeydown: (event) => {
          const row = (event.currentTarget as HTMLElement).closest("tr");
          const next = event.key === "ArrowDown" ? row?.nextElementSibling : event.key === "ArrowUp" ? row?.previousElementSibling : null;
          if (next == null) return;
          event.preventDefault();
          next.querySelector("button")?.focus();
        } }, label),
      now: h("span"),
    }]));
    return table({
      caption: `Markers: distance from ${quoted(this.method)}, mm`,
      name: `markers_${this.options.trial.name}`,
      columns: [{ title: "marker" }, { title: "RMS" }, { title: "now" }],
      rows: [...this.rows].map(([label, { head, now }], k) => [{ text: label, node: head }, cell(number(rms[k]), rms[k] ?? null), { text: "", node: now }]),
      filter: true,
      sorted: { column: 1, down: true },
    });
  }

  private key(event: KeyboardEvent): void {
    if (event.target !== this.theatre?.stage.canvas) return;
    const steps: Record<string, number> = { ",": -1, ".": 1, PageUp: -10, PageDown: 10 };
    const step = steps[event.key];
    if (event.key === " ") this.player.toggle();
    else if (step !== undefined) this.player.step(step);
    else return;
    event.preventDefault();
  }
}
