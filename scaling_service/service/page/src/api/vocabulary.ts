/** What the service knows by name: models, methods, bones, suffixes of files. */

import { getJson } from "./http.ts";
import type { Vocabulary } from "./schema.ts";

let asked: Promise<Vocabulary> | null = null;

/** Asked for once. */
export function vocabulary(): Promise<Vocabulary> {
  asked ??= getJson<Vocabulary>("/v1/vocabulary").catch((error: unknown) => {
    asked = null;
    throw error;
  });
  return asked;
}
