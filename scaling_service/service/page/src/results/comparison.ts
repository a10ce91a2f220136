/** Methods compared: the verdict, the models in space, sizes, errors, angles, forces. */

import { part } from "../api/connection.ts";
import { getResult } from "../api/jobs.ts";
import type { ComparisonDocument, MuscleDocument } from "../api/schema.ts";
import { errors } from "./errors.ts";
import { sizes } from "./sizes.ts";
import { parts, type Finished, type Part, type ResultView } from "./result.ts";
import { verdict } from "./verdict.ts";

export const comparison: ResultView = async (found) => compared(await getResult<ComparisonDocument>(found.job.id, found.signal), found);

export async function compared(document: ComparisonDocument, found: Finished): Promise<void> {
  const played: Part[] = [
    { name: "space", title: "In space", handled: true, show: async (place) => (await part(() => import("./space.ts"))).space(found, place, document.markers_used, preferred(document)) },
    { name: "angles", title: "Angles", show: async (place) => (await part(() => import("./angles.ts"))).angles(document, found, place) },
  ];
  const [space, angles] = found.scene === false ? [[], []] : played.map((one) => [one]);
  await parts("Parts of the comparison", found, [
    { name: "verdict", title: "Verdict", show: (place) => verdict(document, found, place) },
    ...(space ?? []),
    { name: "sizes", title: "Sizes", show: (place) => sizes(document, place) },
    { name: "errors", title: "Errors", show: (place) => errors(document, found, place) },
    ...(angles ?? []),
    ...(document.muscles == null ? [] : [musclesOf(document.muscles, found)]),
    { name: "numbers", title: "Numbers", show: async (place) => (await part(() => import("./numbers.ts"))).numbers(document, place) },
    ...(typeof found.request["subject"] === "string" ? [{ name: "forces", title: "Forces", handled: true, show: async (place: HTMLElement) => (await part(() => import("./forces.ts"))).forces(found, place) }] : []),
  ]);
}

const musclesOf = (document: MuscleDocument, { job, signal }: Finished): Part => (
  { name: "muscles", title: "Muscles", show: async (place) => (await part(() => import("./muscles.ts"))).muscles(document, job.id, signal, place) });

/** Seen at first: what the verdict says, and what it started from. */
function preferred({ verdict, methods }: ComparisonDocument): string[] {
  return [...(verdict === null ? [] : [verdict.method]), ...("MB_am" in methods ? ["MB_am"] : [])];
}
