/** A check of the forces. */

import { getResult } from "../api/jobs.ts";
import type { DynamicsDocument } from "../api/schema.ts";
import { inertia } from "./inertia.ts";
import { residuals } from "./residuals.ts";
import { parts, type ResultView } from "./result.ts";

export const dynamics: ResultView = async (found) => {
  const document = await getResult<DynamicsDocument>(found.job.id, found.signal);
  const { inertial } = document;
  await parts("Parts of the check", found, [
    { name: "residuals", title: "Residual forces", show: (place) => residuals(document, found.job.id, found.signal, place) },
    ...(inertial == null ? [] : [{ name: "inertia", title: "Inertia", show: (place: HTMLElement) => inertia(inertial, place) }]),
  ]);
};
