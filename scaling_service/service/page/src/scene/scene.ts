/** The scene of a job: fetched once, and where its files are. */

import { filePath } from "../api/jobs.ts";
import { getJson } from "../api/http.ts";
import { Problem } from "../api/problem.ts";
import type { SceneDocument } from "../api/schema.ts";

const fetched = new Map<string, Promise<SceneDocument>>();

export function sceneOf(job: string): Promise<SceneDocument> {
  const known = fetched.get(job);
  if (known !== undefined) return known;
  const asked = getJson<SceneDocument>(filePath(job, "scene/scene.json")).catch((error: unknown) => {
    fetched.delete(job);
    if (error instanceof Problem && error.status === 404) {
      throw new Problem({ problem: "This job has no scene to play back: no movement was followed, or it was made by an older version",
        remedy: "Ask for the same again" });
    }
    throw error;
  });
  fetched.set(job, asked);
  return asked;
}

export const pathIn = (job: string) => (file: string): string => filePath(job, file);
