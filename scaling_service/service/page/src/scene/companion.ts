/** A body in space beside curves over time: at the time that is pointed at, with the marker lit that disagrees most then. */

import type { SceneDocument, SceneTrial } from "../api/schema.ts";
import { Player } from "../space/player.ts";
import { Theatre } from "../space/theatre.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { guarded } from "../ui/problem.ts";
import { chipOf } from "../ui/table.ts";
import { away, farthest } from "./farthest.ts";
import { Frames } from "./frames.ts";

export class Companion {
  readonly element: HTMLElement;
  /** Not read out: it changes with every frame. */
  private readonly passing = h("p", { class: "status" });
  private readonly failed = h("div");
  private readonly player: Player;
  private readonly theatre: Theatre | null;
  private readonly errors: Frames | null;

  constructor(
    scene: SceneDocument,
    private readonly trial: SceneTrial,
    private readonly method: string,
    path: (file: string) => string,
    signal: AbortSignal,
  ) {
    const motion = trial.motions[method];
    const colour = styles(scene.bodies.map(({ name }) => name)).get(method)?.colour ?? "";
    const bodies = scene.bodies.flatMap((entry) => (motion === undefined || entry.name !== method ? [] : [{ entry, poses: motion.poses, placed: motion.placed, colour }]));
    this.theatre = staged(() => new Theatre({ ...trial, bodies }, path, `Model of ${method} in ${trial.name}`, signal));
    this.errors = motion === undefined ? null : new Frames(motion.errors, path, signal, () => this.tell());
    this.player = new Player(trial.frames, trial.rate_hz, trial.start_s, (frame) => {
      this.theatre?.showNow(frame);
      this.tell();
    }, () => this.theatre?.stage, signal);
    this.element = h("figure", { class: "picture companion" },
      this.theatre?.stage.element ?? "", this.player.element, this.passing,
      h("figcaption", null, h("span", { class: "labelled" }, chipOf(colour), method), h("span", { class: "measured" }, `measured markers, ${trial.name}`)),
      this.failed);
  }

  /** Fetch what is to be seen, and show a time, s. */
  async begin(time: number): Promise<void> {
    await guarded(this.failed, async () => {
      await Promise.all([this.theatre?.begin([this.method], this.frameAt(time)), this.errors?.begin()]);
      this.look(time);
    });
  }

  /** Show a time, s, that is pointed at, unless something plays. */
  look(time: number): void {
    this.player.look(this.frameAt(time));
  }

  private frameAt(time: number): number {
    return Math.round((time - this.trial.start_s) * this.trial.rate_hz);
  }

  private tell(): void {
    const errors = this.errors?.at(this.player.frame) ?? null;
    const marker = farthest(this.trial.labels, errors);
    this.theatre?.pick(marker);
    this.passing.textContent = marker === null ? "" : `Farthest now: ${marker}, ${away(this.trial.labels, errors, marker, this.method)}`;
  }
}

/** Nothing where a browser cannot draw in space: the words are there all the same. */
function staged(make: () => Theatre): Theatre | null {
  try {
    return make();
  } catch {
    return null;
  }
}
