/** The residual forces of a comparison's subject: of the latest check, or how to get one. */

import { ask, getResult, listJobs } from "../api/jobs.ts";
import type { DynamicsDocument } from "../api/schema.ts";
import { toJob } from "../routes.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { residuals } from "./residuals.ts";
import type { Finished } from "./result.ts";

export async function forces({ request: { subject }, signal }: Finished, place: HTMLElement): Promise<void> {
  if (typeof subject !== "string") return;
  const { items } = await listJobs({ subject, kind: "dynamics", state: "done", limit: "1" }, signal);
  if (signal.aborted) return;
  const [latest] = items;
  if (latest !== undefined) {
    place.append(h("p", null, "The latest check of this subject's forces. ", h("a", { href: toJob(latest.id) }, "All of it")));
    await residuals(await getResult<DynamicsDocument>(latest.id, signal), latest.id, signal, place);
    return;
  }
  const failed = h("div");
  const start = (): void =>
    void guarded(failed, async () => {
      location.hash = toJob((await ask("dynamics", { subject })).id);
    });
  place.append(
    h("p", null, "The forces of this subject were not checked yet. It needs recordings with forces, and a model with feet."),
    h("div", { class: "actions" }, h("button", { class: "main", onclick: start }, "Check the forces")),
    failed,
  );
}
