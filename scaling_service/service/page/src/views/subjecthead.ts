/** The head of a subject's views: where one is, and the steps. */

import { link, toSubject } from "../routes.ts";
import { h } from "../ui/dom.ts";
import { tabs } from "../ui/tabs.ts";

export function subjectHead(id: string, present: "import" | "run" | "report"): HTMLElement {
  return h(
    "div",
    null,
    h("p", { class: "crumbs" }, h("a", { href: link(["subjects"]) }, "Subjects")),
    h("h1", null, id),
    tabs(
      "Steps",
      [
        { name: "import", title: "1. Recordings", href: toSubject(id, "import") },
        { name: "run", title: "2. Analyses", href: toSubject(id, "run") },
        { name: "jobs", title: "3. Results", href: link(["jobs"], { subject: id }) },
        { name: "report", title: "4. Report", href: toSubject(id, "report") },
      ],
      present,
    ),
  );
}
