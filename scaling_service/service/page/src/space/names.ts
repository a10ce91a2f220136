/** Names of markers: of the one that is pointed at, or of all. */

import { Vector3 } from "three";
import { h } from "../ui/dom.ts";
import type { Stage } from "./stage.ts";

/** Chosen: as near as a finger, px. */
const NEAR = 14;

export class Names {
  /** Whether all names are seen. */
  all = false;
  /** Called with the label that is pointed at, null beside them. */
  told: (label: string | null) => void = () => undefined;
  private at: Float32Array = new Float32Array();
  private pointed: number | null = null;
  private kept: number | null = null;
  private readonly spans: HTMLElement[];

  /**
   * @param names what is shown of each marker.
   * @param labels what each is called by.
   */
  constructor(
    private readonly stage: Stage,
    names: readonly string[],
    private readonly labels: readonly string[],
  ) {
    this.spans = names.map((name) => h("span", { hidden: true }, name));
    stage.element.append(h("div", { class: "names", "aria-hidden": "true" }, ...this.spans));
    stage.drawn = () => this.draw();
    stage.canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
      const before = this.pointed;
      this.pointed = this.place(offsetX, offsetY);
      stage.canvas.style.cursor = this.pointed === null ? "" : "pointer";
      if (this.pointed === before) return;
      this.draw();
      this.told(this.pointed === null ? null : (labels[this.pointed] ?? null));
    });
    stage.canvas.addEventListener("pointerleave", () => {
      this.pointed = null;
      this.draw();
      this.told(null);
    });
  }

  /** Show the name of a marker all the time. */
  keep(label: string | null): void {
    this.kept = label === null ? null : this.labels.indexOf(label);
  }

  /** Where the markers are: x, y, z after each other, m. */
  put(at: Float32Array): void {
    this.at = at;
  }

  /** The label of the marker that is nearest to a point of the picture, where one is near. */
  nearest(x: number, y: number): string | null {
    const place = this.place(x, y);
    return place === null ? null : (this.labels[place] ?? null);
  }

  private place(x: number, y: number): number | null {
    let [found, least]: [number | null, number] = [null, NEAR];
    for (let k = 0; k < this.spans.length; k += 1) {
      const seen = this.seen(k);
      const away = seen === null ? Infinity : Math.hypot(seen[0] - x, seen[1] - y);
      if (away < least) [found, least] = [k, away];
    }
    return found;
  }

  /** Where a marker is seen in the picture, px; null where it is not. */
  private seen(k: number): [number, number] | null {
    const at = new Vector3().fromArray(this.at, 3 * k);
    if (!Number.isFinite(at.x)) return null;
    at.project(this.stage.camera);
    if (at.z > 1) return null;
    const { clientWidth, clientHeight } = this.stage.canvas;
    return [((at.x + 1) / 2) * clientWidth, ((1 - at.y) / 2) * clientHeight];
  }

  private draw(): void {
    this.spans.forEach((span, k) => {
      const at = this.all || k === this.pointed || k === this.kept ? this.seen(k) : null;
      span.hidden = at === null;
      if (at !== null) span.style.transform = `translate(${at[0] + 8}px, ${at[1] - 10}px)`;
    });
  }
}
