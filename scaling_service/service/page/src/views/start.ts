/** The first view: try the example, bring recordings, or go on where one was. */

import { listJobs } from "../api/jobs.ts";
import { listSubjects } from "../api/subjects.ts";
import { sendJson } from "../api/http.ts";
import { link, toSubject } from "../routes.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { moment } from "../ui/words.ts";
import { dropZone } from "./drop.ts";
import { jobList } from "./joblist.ts";
import type { Context, View } from "./view.ts";

export const start: View = async (context) => {
  const { main, signal } = context;
  main.append(
    h("h1", null, "Which scaled model to trust, and what the data still hide"),
    h(
      "p",
      null,
      "Bring recordings of markers, of forces and, where there are, of bones. Five methods scale a body model to the person; " +
        "the page shows which one to use, how far to trust it, and which effect the model still lacks.",
    ),
    h("div", { class: "cards" }, bring(), tryOut()),
  );
  await goOn(context);
  signal.throwIfAborted();
};

function bring(): HTMLElement {
  return h("section", { class: "card" }, h("h2", null, "Your recordings"), dropZone(null));
}

function tryOut(): HTMLElement {
  const told = h("div", { role: "status" });
  const button = h("button", { class: "main", onclick: () => {
    button.disabled = true;
    told.textContent = "A virtual person is being made …";
    void guarded(told, loadExample).finally(() => {
      button.disabled = false;
    });
  } }, "Load the example");
  return h(
    "section",
    { class: "card" },
    h("h2", null, "Try it"),
    h(
      "p",
      null,
      "A virtual person whose truth is known, with recordings, bones, and an effect hidden in them. The whole tour works on it.",
    ),
    h("div", { class: "actions" }, button),
    told,
  );
}

async function loadExample(): Promise<void> {
  const { subjects } = await sendJson<{ subjects: string[] }>("/v1/examples", {});
  location.hash = toSubject(subjects[0] ?? "", "import");
}

async function goOn({ main, signal }: Context): Promise<void> {
  const [subjects, jobs] = await Promise.all([listSubjects(signal), listJobs({ limit: "8" }, signal)]);
  if (signal.aborted || subjects.length === 0) return;
  const recent = subjects.slice(0, 8);
  main.append(
    h(
      "div",
      { class: "cards" },
      h(
        "section",
        { class: "card" },
        h("h2", null, "Subjects"),
        h("ul", null, ...recent.map(({ id, updated_at }) =>
          h("li", null, h("a", { href: toSubject(id) }, id), h("span", { class: "quiet" }, ` ${moment(updated_at)}`)))),
        subjects.length > recent.length && h("p", null, h("a", { href: link(["subjects"]) }, `All ${subjects.length}`)),
      ),
      jobs.items.length > 0 &&
        h("section", { class: "card" }, h("h2", null, "Latest jobs"), jobList(jobs.items, signal, { compact: true })),
    ),
  );
}
