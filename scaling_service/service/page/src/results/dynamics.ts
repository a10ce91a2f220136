/** A check of the forces. */

import { getResult } from "../api/jobs.ts";
import type { DynamicsDocument } from "../api/schema.ts";
import { residuals } from "./residuals.ts";
import { parts, type ResultView } from "./result.ts";
import { takeAway } from "./takeaway.ts";

export const dynamics: ResultView = (found) =>
  parts("Parts of the check", found, [
    {
      name: "residuals",
      title: "Residual forces",
      show: async (place) => residuals(await getResult<DynamicsDocument>(found.job.id, found.signal), found.job.id, found.signal, place),
    },
    { name: "files", title: "Take away", show: (place) => takeAway(found, place) },
  ]);
