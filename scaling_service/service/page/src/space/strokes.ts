/** Lines between pairs of points that move. */

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "three";

export class Strokes {
  readonly lines: LineSegments;
  private readonly points: Float32Array;
  private readonly attribute: BufferAttribute;

  constructor(count: number, colour: string) {
    this.points = new Float32Array(6 * count);
    this.attribute = new BufferAttribute(this.points, 3);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.attribute);
    this.lines = new LineSegments(geometry, new LineBasicMaterial({ color: colour }));
    this.lines.frustumCulled = false;
  }

  /** One line from a point to another; of no length where either is unknown. */
  put(place: number, from: ArrayLike<number>, a: number, to: ArrayLike<number>, b: number): void {
    let known = true;
    for (let k = 0; k < 3; k += 1) known &&= Number.isFinite((from[a + k] ?? NaN) + (to[b + k] ?? NaN));
    for (let k = 0; k < 3; k += 1) {
      this.points[6 * place + k] = known ? (from[a + k] ?? 0) : 0;
      this.points[6 * place + 3 + k] = known ? (to[b + k] ?? 0) : 0;
    }
  }

  done(): void {
    this.attribute.needsUpdate = true;
  }
}
