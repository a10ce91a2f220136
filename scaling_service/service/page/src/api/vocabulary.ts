/** What the service knows by name: models, methods, bones, suffixes of files. */

import { getJson } from "./http.ts";

export interface KnownModel {
  name: string;
  segments: string[];
  markers: { name: string; segment: string; anatomical: boolean }[];
  coordinates: { name: string; unit: string }[];
  feet: boolean;
}

export interface KnownMethod {
  name: string;
  meaning: string;
  starts_from: string | null;
  needs_images: boolean;
}

export interface Vocabulary {
  models: KnownModel[];
  methods: KnownMethod[];
  bones: string[];
}

let asked: Promise<Vocabulary> | null = null;

/** Asked for once. */
export function vocabulary(): Promise<Vocabulary> {
  asked ??= getJson<Vocabulary>("/v1/vocabulary").catch((error: unknown) => {
    asked = null;
    throw error;
  });
  return asked;
}
