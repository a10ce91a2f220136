/** The first view: try the example, bring recordings, or go on where one was. */

import { listJobs } from "../api/jobs.ts";
import { listSubjects } from "../api/subjects.ts";
import { sendJson } from "../api/http.ts";
import { link, toSubject } from "../routes.ts";
import { fill, h } from "../ui/dom.ts";
import result from "../../pictures/result.webp";
import { guarded } from "../ui/problem.ts";
import { moment } from "../ui/words.ts";
import { dropZone } from "./drop.ts";
import { jobList } from "./joblist.ts";
import type { Context, View } from "./view.ts";

export const start: View = async (context) => {
  const { main, signal } = context;
  main.append(
    h("div", { class: "hero" },
      h("div", null,
        h("h1", null, "Which scaled model to trust, and what the data still hide"),
        h("p", null, "Bring recordings of markers and, where you have them, of forces and bones."),
        h("p", null, "A body model is scaled to the person by the markers, images and what is ordinary in people; you see how far to trust it, and what five other methods say."),
        h("p", null, "Where model and recordings still disagree, a search names the missing effect and checks it on recordings that it has not seen."),
        tryOut()),
      h("figure", null, h("img", { src: result, width: 1100, height: 554, alt: "A verdict: which model to use, why and how far to trust it, the models in space over measured markers, and the error of each method with its spread." }),
        h("figcaption", { class: "note" }, "What you get: the verdict on the example"))),
    bring(),
  );
  await goOn(context);
  signal.throwIfAborted();
};

function bring(): HTMLElement {
  return h("section", { class: "card" }, h("h2", null, "Your recordings"), dropZone(null));
}

function tryOut(): HTMLElement {
  const status = h("div", { role: "status" });
  const button = h("button", { class: "main", onclick: () => {
    button.disabled = true;
    fill(status, h("progress", { "aria-label": "Making the example" }), h("p", { class: "quiet" }, "A virtual person is being made …"));
    void guarded(status, loadExample).finally(() => {
      button.disabled = false;
    });
  } }, "Load the example");
  return h("div", null, h("div", { class: "actions" }, button, h("span", { class: "quiet" }, "A virtual person with bones, and two effects hidden in the recordings.")), status);
}

async function loadExample(): Promise<void> {
  const { subjects } = await sendJson<{ subjects: string[] }>("/v1/examples", {});
  location.hash = toSubject(subjects[0] ?? "", "import");
}

async function goOn({ main, signal }: Context): Promise<void> {
  const [subjects, jobs] = await Promise.all([listSubjects(signal), listJobs({ limit: "30" }, signal)]);
  if (signal.aborted || subjects.length === 0) return;
  const analyses = jobs.items.filter(({ kind }) => kind !== "proof" && kind !== "batch-member").slice(0, 8);
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
      analyses.length > 0 &&
        h("section", { class: "card" }, h("h2", null, "Latest results"), jobList(analyses, signal, { compact: true })),
    ),
  );
}
