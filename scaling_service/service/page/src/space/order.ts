/** The order of a surface's triangles and vertices: neighbours after each other.
 *
 * Graphics hardware, and still more what stands in for it in software, computes a vertex again that it has
 * not used for a while. Fans of triangles around one vertex after the other make use of what is known
 * (Sander et al. 2007, "Fast triangle reordering for vertex locality and reduced overdraw").
 */

import type { BufferGeometry } from "three";

/** Vertices that are surely still known. Chosen: small enough for every renderer. */
const CACHE = 16;

/** Bring the triangles of an indexed surface into a good order; the surface stays the same. */
export function wellOrdered(geometry: BufferGeometry): void {
  const index = geometry.getIndex();
  if (index === null) return;
  const triangles = fans(Uint32Array.from(index.array), geometry.attributes.position?.count ?? 0);
  renumber(geometry, triangles);
}

function fans(index: Uint32Array, count: number): Uint32Array {
  const { starts, triangles } = around(index, count);
  const left = new Uint32Array(count);
  for (let v = 0; v < count; v += 1) left[v] = (starts[v + 1] ?? 0) - (starts[v] ?? 0);
  const usedAt = new Uint32Array(count);
  const done = new Uint8Array(index.length / 3);
  const found = new Uint32Array(index.length);
  const recent: number[] = [];
  let [size, time, cursor] = [0, CACHE + 1, 0];
  let centre = 0;
  while (centre >= 0) {
    const near: number[] = [];
    for (let k = starts[centre] ?? 0; k < (starts[centre + 1] ?? 0); k += 1) {
      const triangle = triangles[k] ?? 0;
      if (done[triangle] === 1) continue;
      done[triangle] = 1;
      for (let corner = 0; corner < 3; corner += 1) {
        const vertex = index[3 * triangle + corner] ?? 0;
        found[size] = vertex;
        size += 1;
        recent.push(vertex);
        near.push(vertex);
        left[vertex] = (left[vertex] ?? 1) - 1;
        if (time - (usedAt[vertex] ?? 0) > CACHE) {
          usedAt[vertex] = time;
          time += 1;
        }
      }
    }
    centre = best(near, left, usedAt, time);
    while (centre < 0 && recent.length > 0) {
      const vertex = recent.pop() ?? 0;
      if ((left[vertex] ?? 0) > 0) centre = vertex;
    }
    while (centre < 0 && cursor < count) {
      if ((left[cursor] ?? 0) > 0) centre = cursor;
      cursor += 1;
    }
  }
  return found;
}

/** The vertex to go on with: the oldest that is still known when its own fan is done. */
function best(near: readonly number[], left: Uint32Array, usedAt: Uint32Array, time: number): number {
  let [found, most] = [-1, -1];
  for (const vertex of near) {
    const rest = left[vertex] ?? 0;
    if (rest === 0) continue;
    const age = time - (usedAt[vertex] ?? 0);
    const worth = age + 2 * rest <= CACHE ? age : 0;
    if (worth > most) [found, most] = [vertex, worth];
  }
  return found;
}

/** The triangles around each vertex: those of `v` are `triangles[starts[v]]` up to `starts[v + 1]`. */
function around(index: Uint32Array, count: number): { starts: Uint32Array; triangles: Uint32Array } {
  const starts = new Uint32Array(count + 1);
  for (const vertex of index) starts[vertex + 1] = (starts[vertex + 1] ?? 0) + 1;
  for (let v = 0; v < count; v += 1) starts[v + 1] = (starts[v + 1] ?? 0) + (starts[v] ?? 0);
  const next = starts.slice();
  const triangles = new Uint32Array(index.length);
  index.forEach((vertex, k) => {
    const place = next[vertex] ?? 0;
    triangles[place] = Math.floor(k / 3);
    next[vertex] = place + 1;
  });
  return { starts, triangles };
}

/** Number the vertices in the order in which the triangles use them. */
function renumber(geometry: BufferGeometry, index: Uint32Array): void {
  const count = geometry.attributes.position?.count ?? 0;
  const numbers = new Int32Array(count).fill(-1);
  let size = 0;
  const renamed = index.map((vertex) => {
    if (numbers[vertex] === -1) {
      numbers[vertex] = size;
      size += 1;
    }
    return numbers[vertex] ?? 0;
  });
  for (const attribute of Object.values(geometry.attributes)) {
    const { array, itemSize } = attribute;
    const before = array.slice();
    numbers.forEach((to, from) => {
      for (let k = 0; to >= 0 && k < itemSize; k += 1) array[to * itemSize + k] = before[from * itemSize + k] ?? 0;
    });
  }
  geometry.getIndex()?.array.set(renamed);
}
