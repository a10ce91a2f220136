/** A surface with fewer triangles, for machines that draw slowly: vertices of one cell of a grid become one. */

import { BufferGeometry, Float32BufferAttribute } from "three";

/** Chosen: at the size of a thumb on screen nobody sees the difference while it moves. */
const FACES = 3500;

export function coarsened(fine: BufferGeometry): BufferGeometry {
  const index = fine.getIndex();
  const position = fine.attributes.position;
  if (index === null || position === undefined || index.count / 3 <= FACES) return fine;
  const cell = cellSize(fine, index.count / 3);
  const cells = new Map<string, number>();
  const sums: number[] = [];
  const counts: number[] = [];
  const places = new Uint32Array(position.count);
  for (let v = 0; v < position.count; v += 1) {
    const at = [position.getX(v), position.getY(v), position.getZ(v)];
    const name = at.map((x) => Math.floor(x / cell)).join(" ");
    const place = cells.get(name) ?? cells.size;
    cells.set(name, place);
    places[v] = place;
    counts[place] = (counts[place] ?? 0) + 1;
    at.forEach((x, k) => (sums[3 * place + k] = (sums[3 * place + k] ?? 0) + x));
  }
  const kept: number[] = [];
  for (let k = 0; k < index.count; k += 3) {
    const [a, b, c] = [0, 1, 2].map((corner) => places[index.getX(k + corner)] ?? 0) as [number, number, number];
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(sums.map((x, k) => x / (counts[Math.floor(k / 3)] ?? 1)), 3));
  geometry.setIndex(kept);
  geometry.computeVertexNormals();
  return geometry;
}

/** Closed surfaces have about half as many cells that they pass as faces that are left. */
function cellSize(fine: BufferGeometry, faces: number): number {
  const index = fine.getIndex();
  const position = fine.attributes.position;
  if (index === null || position === undefined) return 1;
  let area = 0;
  const [p, q, r] = [[0, 0, 0], [0, 0, 0], [0, 0, 0]] as [number[], number[], number[]];
  for (let face = 0; face < faces; face += 1) {
    [p, q, r].forEach((corner, k) => {
      const v = index.getX(3 * face + k);
      [corner[0], corner[1], corner[2]] = [position.getX(v), position.getY(v), position.getZ(v)];
    });
    const u = q.map((x, k) => x - (p[k] ?? 0));
    const v = r.map((x, k) => x - (p[k] ?? 0));
    area += 0.5 * Math.hypot(
      (u[1] ?? 0) * (v[2] ?? 0) - (u[2] ?? 0) * (v[1] ?? 0),
      (u[2] ?? 0) * (v[0] ?? 0) - (u[0] ?? 0) * (v[2] ?? 0),
      (u[0] ?? 0) * (v[1] ?? 0) - (u[1] ?? 0) * (v[0] ?? 0),
    );
  }
  return Math.sqrt((2 * area) / FACES);
}
