/** The marker that disagrees most at one time: what playback, the map of the error and curves light alike. */

import { number } from "../ui/words.ts";

/** A name of several words within a sentence. */
export const quoted = (name: string): string => (name.includes(" ") ? `“${name}”` : name);

/** The marker with the largest error of a frame; null where none is seen. */
export function farthest(labels: readonly string[], errors: Float32Array | null): string | null {
  let [found, most]: [string | null, number] = [null, -1];
  errors?.forEach((error, k) => {
    if (error > most) [found, most] = [labels[k] ?? null, error];
  });
  return found;
}

/** How far a marker is from a body's, in words. */
export function away(labels: readonly string[], errors: Float32Array | null, marker: string | null, body: string): string {
  const error = marker === null ? undefined : errors?.[labels.indexOf(marker)];
  return error === undefined || Number.isNaN(error) ? "not seen" : `${number(error)} mm from ${quoted(body)}`;
}
