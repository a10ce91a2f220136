/** Markers as small spheres, all in one draw; what is not known is not drawn. */

import { Color, InstancedMesh, Matrix4, MeshLambertMaterial, SphereGeometry } from "three";

const HIDDEN = new Matrix4().makeScale(0, 0, 0);

export class Dots {
  readonly mesh: InstancedMesh;
  private readonly matrix = new Matrix4();

  /** @param inside whether they are seen through what lies before them, such as bones. */
  constructor(count: number, radius_m: number, colour: string, inside = false) {
    const material = new MeshLambertMaterial({ color: 0xffffff, depthTest: !inside, transparent: inside });
    this.mesh = new InstancedMesh(new SphereGeometry(radius_m, 8, 6), material, count);
    if (inside) this.mesh.renderOrder = 1;
    this.mesh.frustumCulled = false;
    for (let k = 0; k < count; k += 1) this.paint(k, colour);
    this.hideAll();
  }

  paint(place: number, colour: string): void {
    this.mesh.setColorAt(place, new Color(colour));
    if (this.mesh.instanceColor !== null) this.mesh.instanceColor.needsUpdate = true;
  }

  /** Where each is: x, y, z after each other, m. */
  put(positions: ArrayLike<number>): void {
    for (let k = 0; k < this.mesh.count; k += 1) {
      const [x, y, z] = [positions[3 * k] ?? NaN, positions[3 * k + 1] ?? NaN, positions[3 * k + 2] ?? NaN];
      this.mesh.setMatrixAt(k, Number.isFinite(x + y + z) ? this.matrix.makeTranslation(x, y, z) : HIDDEN);
    }
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }

  hideAll(): void {
    for (let k = 0; k < this.mesh.count; k += 1) this.mesh.setMatrixAt(k, HIDDEN);
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
