/** One recording in space as it was read: markers, plates, forces, and where the person walks. */

import type { RecordingProof } from "../api/schema.ts";
import { Player } from "../space/player.ts";
import { arrow, triad } from "../space/signs.ts";
import { Theatre } from "../space/theatre.ts";
import { h } from "../ui/dom.ts";
import { problemBox } from "../ui/problem.ts";
import { words } from "../ui/words.ts";
import { gapTimeline } from "./gaps.ts";

export class Preview {
  readonly element = h("div");
  readonly gaps: HTMLElement;
  private theatre: Theatre | null = null;
  private readonly player: Player;

  /** @param picked called with the label that was clicked. */
  constructor(
    private readonly recording: RecordingProof,
    private readonly path: (file: string) => string,
    private readonly names: ReadonlyMap<string, { marker: string; segment: string }>,
    private readonly picked: (label: string | null) => void,
    private readonly signal: AbortSignal,
  ) {
    const { frames, rate_hz, start_s } = recording;
    this.gaps = gapTimeline(recording, (frame, label) => {
      this.player.step(frame - this.player.frame);
      this.mark(label);
      this.picked(label);
    });
    this.player = new Player(frames, rate_hz, start_s, (frame) => this.theatre?.showNow(frame), () => this.theatre?.stage, signal);
  }

  async begin(): Promise<void> {
    const { recording } = this;
    const { markers, labels, plates, force, centre_of_pressure } = recording;
    const play = { labels: labels.map(({ label }) => label), measured: markers, plates, force, centre_of_pressure, bodies: [], segments: labels.map(({ label }) => this.names.get(label)?.segment),
      named: (label: string) => { const found = this.names.get(label); return found === undefined ? label : `${label}: ${found.marker} on ${words(found.segment)}`; } };
    try {
      this.theatre = new Theatre(play, this.path, `Markers of ${recording.name}`, this.signal);
    } catch {
      this.element.append(problemBox({ problem: "This browser cannot draw in space (WebGL is missing)", remedy: "Use another browser; the tables are all there" }, "warning"));
    }
    const { theatre } = this;
    if (theatre !== null) {
      theatre.picked = this.picked;
      this.element.append(theatre.stage.element, this.player.element);
      await theatre.begin([], 0);
      theatre.mark(triad(recording.axes.R_new_old), ...(recording.direction === null ? [] : [arrow(recording.direction)]));
    }
  }

  /** Show a time, s. */
  go(time_s: number): void {
    this.player.step(Math.round((time_s - this.recording.start_s) * this.recording.rate_hz) - this.player.frame);
  }

  /** The time that is shown, s. */
  get now(): number {
    return this.recording.start_s + this.player.frame / this.recording.rate_hz;
  }

  mark(label: string): void {
    this.theatre?.pick(label);
  }
}
