/** Lines between markers that let a body be seen: the shortest tree that joins them (Prim 1957). */

/** Chosen: lines rather stay on a segment, and hardly ever cross from one leg to the other. */
const OTHER_SEGMENT = 2;
const OTHER_SIDE = 20;

/** Pairs of places; `at` are the positions x, y, z after each other, `segments` of each marker where known. */
export function joined(at: Float32Array, segments: readonly (string | undefined)[]): [number, number][] {
  const open = segments.flatMap((segment, k) => (segment !== undefined && Number.isFinite(at[3 * k] ?? NaN) ? [k] : []));
  const first = open.shift();
  if (first === undefined) return [];
  const nearest = new Map(open.map((k) => [k, { to: first, length: length(first, k) }]));
  const links: [number, number][] = [];
  while (nearest.size > 0) {
    const [next, { to }] = [...nearest].reduce((a, b) => (b[1].length < a[1].length ? b : a));
    links.push([to, next]);
    nearest.delete(next);
    for (const [k, known] of nearest) {
      const other = length(next, k);
      if (other < known.length) nearest.set(k, { to: next, length: other });
    }
  }
  return links;

  function length(a: number, b: number): number {
    const away = Math.hypot(...[0, 1, 2].map((i) => (at[3 * a + i] ?? 0) - (at[3 * b + i] ?? 0)));
    const [one = "", other = ""] = [segments[a], segments[b]];
    if (one === other) return away;
    const sides = one.slice(-2) + other.slice(-2);
    return away * (sides === "_r_l" || sides === "_l_r" ? OTHER_SIDE : OTHER_SEGMENT);
  }
}
