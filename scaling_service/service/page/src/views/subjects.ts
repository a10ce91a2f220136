/** All subjects, and where new ones are brought in. */

import { deleteSubject, listSubjects } from "../api/subjects.ts";
import { again, link, toSubject } from "../routes.ts";
import { confirmed } from "../ui/dialog.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { moment } from "../ui/words.ts";
import { dropZone } from "./drop.ts";
import type { View } from "./view.ts";

export const subjects: View = async ({ main, signal }) => {
  const found = await listSubjects(signal);
  const failed = h("div");
  main.append(h("h1", null, "Subjects"), dropZone(null), failed);
  if (found.length === 0) return;
  const rows = found.map(({ id, updated_at }): Cell[] => [
    { text: id, node: h("a", { href: toSubject(id) }, id) },
    cell(moment(updated_at), updated_at),
    { text: "", node: h("a", { href: toSubject(id, "run") }, "run") },
    { text: "", node: h("a", { href: link(["jobs"], { subject: id }) }, "jobs") },
    { text: "", node: removal(id, failed) },
  ]);
  const columns = ["subject", "changed", "", "", ""].map((title) => ({ title }));
  main.append(table({ caption: "All subjects", name: "subjects", columns, rows, filter: true }));
};

function removal(id: string, failed: HTMLElement): HTMLElement {
  const ask = async (): Promise<void> => {
    if (await confirmed(`Delete ${id}, its files and all jobs on them, for good?`, "Delete")) {
      await deleteSubject(id);
      again();
    }
  };
  return h("button", { class: "small", "aria-label": `Delete ${id}`, onclick: () => void guarded(failed, ask) }, "Delete");
}
