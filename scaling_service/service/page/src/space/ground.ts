/** Force plates with their corners, and the force on each as an arrow. */

import type { PlateEntry } from "../api/schema.ts";
import { ArrowHelper, BufferGeometry, Color, Float32BufferAttribute, Group, LineBasicMaterial, LineLoop, Vector3 } from "three";

/** Chosen: an arrow of a standing person is as long as a leg. */
export const NEWTON_PER_METRE = 900;
const LEAST_N = 15;
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"];

export class Ground {
  readonly group = new Group();
  private readonly arrows: ArrowHelper[];

  constructor(plates: readonly PlateEntry[]) {
    this.arrows = plates.map((_, k) => {
      const arrow = new ArrowHelper(new Vector3(0, 1, 0), new Vector3(), 1, new Color(colourOf(k)), 0.06, 0.035);
      arrow.visible = false;
      return arrow;
    });
    plates.forEach(({ corners_m }, k) => {
      if (corners_m !== null) this.group.add(outline(corners_m.flat(), colourOf(k)));
    });
    for (const arrow of this.arrows) this.group.add(arrow);
  }

  /** Three numbers for each plate: the force, N, and where it acts, m. */
  put(force: Float32Array, centre: Float32Array): void {
    this.arrows.forEach((arrow, k) => {
      const push = new Vector3().fromArray(force, 3 * k);
      const at = new Vector3().fromArray(centre, 3 * k);
      const size = push.length();
      arrow.visible = size > LEAST_N && Number.isFinite(size + at.lengthSq());
      if (!arrow.visible) return;
      arrow.position.copy(at);
      arrow.setDirection(push.normalize());
      arrow.setLength(size / NEWTON_PER_METRE, 0.06, 0.035);
    });
  }
}

const colourOf = (plate: number): string => COLOURS[plate % COLOURS.length] ?? "";

function outline(corners: number[], colour: string): LineLoop {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(corners, 3));
  return new LineLoop(geometry, new LineBasicMaterial({ color: colour }));
}
