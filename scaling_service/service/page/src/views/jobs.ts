/** The history: all jobs, newest first, of one subject, kind or state where chosen. */

import { listJobs, type Chosen } from "../api/jobs.ts";
import { link } from "../routes.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { kindInWords } from "../ui/words.ts";
import { jobList } from "./joblist.ts";
import type { View } from "./view.ts";

const KINDS = ["scaling", "discovery", "dynamics", "consistent", "batch", "proof", "joint-angles", "landmarks"];
const STATES = ["running", "queued", "done", "failed", "cancelled"];

export const jobs: View = async ({ main, place, signal }) => {
  const chosen: Chosen = { limit: "30" };
  for (const name of ["subject", "kind", "state"] as const) {
    const value = place.query.get(name);
    if (value !== null) chosen[name] = value;
  }
  const change = (name: string, value: string): void => {
    const query = Object.fromEntries([...place.query.entries(), [name, value]].filter(([, given]) => given !== ""));
    location.hash = link(["jobs"], query as Record<string, string>);
  };
  const any = { value: "", text: "any" };
  main.append(
    h("h1", null, chosen.subject === undefined ? "Jobs" : `Jobs on ${chosen.subject}`),
    h("div", { class: "bar" },
      select("kind", [any, ...KINDS.map((value) => ({ value, text: kindInWords(value) }))], chosen.kind ?? "", (v) => change("kind", v)),
      select("state", [any, ...STATES.map((value) => ({ value, text: value }))], chosen.state ?? "", (v) => change("state", v)),
      chosen.subject !== undefined && h("a", { href: link(["jobs"]) }, "of all subjects")),
  );
  const list = h("div");
  const failed = h("div");
  const more = h("button", { onclick: () => void guarded(failed, load) }, "Older ones");
  main.append(list, failed, more);

  async function load(): Promise<void> {
    const page = await listJobs(chosen, signal);
    list.append(page.items.length === 0 ? h("p", { class: "quiet" }, "None yet.") : jobList(page.items, signal));
    more.hidden = page.next === null;
    if (page.next !== null) chosen.cursor = page.next;
  }
  await load();
};
