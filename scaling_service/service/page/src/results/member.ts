/** A member of a cohort on a page of its own: its comparison, from the files that the cohort has of it. */

import { getJson } from "../api/http.ts";
import { filePath, getResult } from "../api/jobs.ts";
import type { ComparisonDocument, MemberResult } from "../api/schema.ts";
import { toJob } from "../routes.ts";
import { callout } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { guarded, sentence } from "../ui/problem.ts";
import { open } from "../ui/save.ts";
import { compared } from "./comparison.ts";
import type { Finished, ResultView } from "./result.ts";

/** The job of one member. */
export const member: ResultView = async (found) => {
  const { status, reason } = await getResult<MemberResult>(found.job.id, found.signal);
  const { subject } = found.request;
  if (status === "skipped" || typeof subject !== "string") {
    found.main.append(callout("Skipped", "unknown", h("p", null, sentence(reason))));
    return;
  }
  await memberOf(found, subject, ["jobs", found.job.id]);
};

/** A member's part of a job's files.
 *
 * @param folder where its files are among the job's.
 * @param base what stands before the names of its parts in the address.
 */
export async function memberOf(found: Finished, folder: string, base: readonly string[]): Promise<void> {
  const document = await getJson<ComparisonDocument>(filePath(found.job.id, `${folder}/comparison.json`), found.signal);
  const failed = h("div");
  const report = (): void => void guarded(failed, () => open(filePath(found.job.id, `${folder}/report.html`)));
  found.main.append(
    h("div", { class: "bar" }, h("h2", null, document.subject), h("span", { class: "push" }),
      base.length > 2 && h("a", { href: toJob(found.job.id) }, "All subjects"),
      h("button", { class: "small", onclick: report }, "Its report, with the models in space")),
    failed);
  await compared(document, { ...found, base, scene: false, request: {}, takeAway: (_, place) => found.takeAway(found, place) });
}
