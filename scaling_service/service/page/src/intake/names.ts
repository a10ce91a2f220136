/** Names under which the service keeps files: letters of any alphabet, digits, and a few signs. */

import { baseName } from "./entries.ts";

const NOT_KEPT = /[^\p{L}\p{N}_ .()+=@,-]/gu;
const LONGEST = 200;

/** The name of a file as it is kept: without folders, with `_` for every sign that cannot be kept. */
export function keptName(path: string): string {
  const name = baseName(path).normalize("NFC").replace(NOT_KEPT, "_").replace(/[ .]+$/, "");
  const begun = /^[\p{L}\p{N}_]/u.test(name) ? name : `_${name}`;
  return begun.slice(0, LONGEST);
}
