/** Where files are dropped or chosen. */

import { link, again, toSubject } from "../routes.ts";
import { chosenEntries, droppedEntries, type Entry } from "../intake/entries.ts";
import { bring, proposedId, uploadAll } from "../intake/bringing.ts";
import { keepForCohort } from "../intake/cohort.ts";
import { sortedOut, type Intake } from "../intake/subjectfile.ts";
import { fill, h, newId } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";

/** A place for files of a new subject, or of one that exists.
 *
 * Several subject files, or a table of them, lead to the cohort.
 */
export function dropZone(subject: string | null): HTMLElement {
  const failed = h("div");
  const status = h("p", { class: "quiet", role: "status" });
  const more = h("div");
  const tell = (text: string): void => void (status.textContent = text);
  const take = (entries: Promise<Entry[]> | Entry[]): void =>
    void guarded(failed, async () => {
      const found = await entries;
      if (found.length > 0) await taken(found, subject, tell, more, failed);
    });
  return dropBox(
    take,
    h("p", null, subject === null
      ? "Drop a folder or files here: recordings (C3D, TRC), forces (MOT), a model (.osim), bones (STL, PLY, OBJ, VTP, or a segmentation as NIfTI), a subject file."
      : `Drop more files of ${subject} here. One of the same name is replaced.`),
    status,
    more,
    failed,
  );
}

/** A box that takes files, whatever happens to them then. */
export function dropBox(take: (entries: Promise<Entry[]> | Entry[]) => void, ...content: HTMLElement[]): HTMLElement {
  const zone: HTMLElement = h(
    "div",
    {
      class: "drop",
      ondragover: (event) => {
        event.preventDefault();
        zone.classList.add("over");
      },
      ondragleave: () => zone.classList.remove("over"),
      ondrop: (event) => {
        event.preventDefault();
        zone.classList.remove("over");
        if (event.dataTransfer !== null) take(droppedEntries(event.dataTransfer));
      },
    },
    ...content.slice(0, 1),
    h("div", { class: "actions" }, chooser("Choose files", false, take), chooser("Choose a folder", true, take)),
    ...content.slice(1),
  );
  return zone;
}

function chooser(title: string, folder: boolean, take: (entries: Entry[]) => void): HTMLElement {
  const input: HTMLInputElement = h("input", { type: "file", multiple: true, class: "sr", tabindex: -1, "aria-label": title,
    onchange: () => {
      if (input.files !== null) take(chosenEntries(input.files));
      input.value = "";
    } });
  if (folder) input.setAttribute("webkitdirectory", "");
  return h("span", null, h("button", { type: "button", onclick: () => input.click() }, title), input);
}

async function taken(
  entries: Entry[],
  subject: string | null,
  tell: (text: string) => void,
  more: HTMLElement,
  failed: HTMLElement,
): Promise<void> {
  if (subject !== null) {
    await uploadAll(subject, entries, tell);
    again();
    return;
  }
  const found = await sortedOut(entries);
  const [only] = found;
  if (found.length > 1) {
    keepForCohort(entries);
    location.hash = link(["cohort"]);
  } else if (only !== undefined && only.document !== null) {
    location.hash = toSubject(await bring(only, "", tell));
  } else if (only !== undefined) {
    fill(more, nameForm(only, tell, failed));
  }
}

function nameForm(intake: Intake, tell: (text: string) => void, failed: HTMLElement): HTMLElement {
  const id = newId("name");
  const input = h("input", { id, value: proposedId(intake.files), required: true, maxlength: 100 });
  const form = h(
    "form",
    {
      class: "actions",
      onsubmit: (event) => {
        event.preventDefault();
        void guarded(failed, async () => {
          location.hash = toSubject(await bring(intake, input.value.trim(), tell));
        });
      },
    },
    h("label", { for: id }, intake.files.length === 1 ? "Whose file is this?" : `Whose ${intake.files.length} files are these?`),
    input,
    h("button", { class: "main" }, "Check them"),
  );
  queueMicrotask(() => input.focus());
  return form;
}
