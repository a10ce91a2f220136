/** How the result of a kind of job is shown; each view is loaded when it is first needed. */

import { part } from "../api/connection.ts";
import type { ResultView } from "./result.ts";

export async function viewOf(kind: string): Promise<ResultView> {
  switch (kind) {
    case "scaling":
      return (await part(() => import("./comparison.ts"))).comparison;
    case "discovery":
      return (await part(() => import("./discovery.ts"))).discovery;
    case "motion":
      return (await part(() => import("./motion.ts"))).motion;
    case "dynamics":
      return (await part(() => import("./dynamics.ts"))).dynamics;
    case "consistent":
      return (await part(() => import("./consistent.ts"))).consistent;
    case "batch":
      return (await part(() => import("./cohort.ts"))).cohort;
    case "study":
      return (await part(() => import("./study.ts"))).study;
    case "proof":
      return (await part(() => import("./proof.ts"))).proof;
    default:
      return (await part(() => import("./plain.ts"))).plain;
  }
}
