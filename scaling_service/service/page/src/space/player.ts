/** Playing a recording: play, speed, step, and a cursor that others can set. */

import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";

/** While playing, the clock and the slider change this often: people read no faster, and painting them costs. */
const TELL_MS = 100;
const SPEEDS = ["0.1", "0.25", "0.5", "1", "2"];

interface Pacing {
  play: (playing: boolean) => void;
  paced: (milliseconds: number) => void;
}

export class Player {
  readonly element: HTMLElement;
  private readonly slider: HTMLInputElement;
  private readonly button: HTMLButtonElement;
  private readonly clock = h("output", { class: "clock" });
  private readonly pace = h("span", { class: "quiet pace" });
  private position = 0;
  private speed = 1;
  private playing = false;
  private toldAt = 0;
  private ended: (() => void) | null = null;

  /**
   * @param show called with each frame that is to be seen.
   * @param stage told when playing begins and ends, and how long pictures take.
   */
  constructor(
    private readonly frames: number,
    private readonly rate_hz: number,
    private readonly start_s: number,
    private readonly show: (frame: number) => void,
    private readonly stage: () => Pacing | undefined,
    private readonly signal: AbortSignal,
  ) {
    this.slider = h("input", { type: "range", min: 0, max: frames - 1, step: 1, value: 0, "aria-label": "Frame",
      oninput: () => this.go(Number(this.slider.value)) });
    this.button = h("button", { class: "play", onclick: () => this.toggle() }, "Play");
    this.element = h(
      "div",
      { class: "player" },
      this.button,
      h("button", { "aria-label": "One frame back", onclick: () => this.step(-1) }, "◀"),
      h("button", { "aria-label": "One frame on", onclick: () => this.step(1) }, "▶"),
      this.slider,
      this.clock,
      select("speed", SPEEDS.map((value) => ({ value, text: `${value} ×` })), "1", (value) => void (this.speed = Number(value))),
      this.pace,
    );
    this.tell();
  }

  get frame(): number {
    return Math.floor(this.position);
  }

  /** The time that is shown, s. */
  get time(): number {
    return this.start_s + this.frame / this.rate_hz;
  }

  /** Show a frame that is pointed at, unless something plays; whether it is shown. */
  look(frame: number): boolean {
    if (!this.playing) this.go(frame);
    return !this.playing;
  }

  /** Show a frame. */
  go(frame: number): void {
    this.position = Math.min(Math.max(frame, 0), this.frames - 1);
    this.tell();
    this.show(this.frame);
  }

  step(by: number): void {
    this.stop();
    this.go(this.frame + by);
  }

  /** Play once from the beginning to the end. */
  through(): Promise<void> {
    this.stop();
    this.go(0);
    return new Promise((resolve) => {
      this.ended = resolve;
      this.play();
    });
  }

  toggle(): void {
    if (this.playing) this.stop();
    else this.play();
  }

  private play(): void {
    this.playing = true;
    this.button.textContent = "Pause";
    this.stage()?.play(true);
    let before = performance.now();
    let counted = 0;
    let since = before;
    const next = (now: number): void => {
      if (!this.playing || this.signal.aborted) return;
      const past = now - before;
      before = now;
      const on = this.position + (this.speed * this.rate_hz * past) / 1000;
      if (on >= this.frames && this.ended !== null) {
        this.step(0);
        return;
      }
      this.position = on % this.frames;
      if (now - this.toldAt > TELL_MS) {
        this.toldAt = now;
        this.tell();
      }
      this.show(this.frame);
      this.stage()?.paced(past);
      counted += 1;
      if (now - since > 1000) {
        this.pace.textContent = `${Math.round((1000 * counted) / (now - since))} pictures/s`;
        [counted, since] = [0, now];
      }
      requestAnimationFrame(next);
    };
    requestAnimationFrame((now) => {
      before = since = now;
      requestAnimationFrame(next);
    });
  }

  private stop(): void {
    if (!this.playing) return;
    this.playing = false;
    this.stage()?.play(false);
    this.button.textContent = "Play";
    this.pace.textContent = "";
    this.ended?.();
    this.ended = null;
  }

  private tell(): void {
    const { time } = this;
    this.slider.value = String(this.frame);
    this.slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    this.clock.textContent = `${time.toFixed(2)} s · ${this.frame + 1} / ${this.frames}`;
  }
}
