/** What people write about a person's results, and who signs it. */

import { getJson, sendJson } from "../api/http.ts";
import type { SubjectNote, SubjectNoteDocument } from "../api/schema.ts";
import { fill, h, newId } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { moment } from "../ui/words.ts";

const pathOf = (subject: string): string => `/v1/subjects/${encodeURIComponent(subject)}/note`;

/** @param results the jobs whose results are shown, and which a signature is for. */
export async function noteSection(subject: string, results: readonly string[], signal: AbortSignal): Promise<HTMLElement> {
  const [failed, status, printed] = [h("div"), h("p", { role: "status" }), h("p", { class: "printed" })];
  const [textId, nameId] = [newId("note"), newId("signed")];
  const text = h("textarea", { id: textId, rows: 4, maxlength: 20_000 });
  const name = h("input", { id: nameId, maxlength: 200, autocomplete: "name" });
  const show = (kept: SubjectNoteDocument): void => {
    text.value = kept.text;
    printed.textContent = kept.text;
    const others = results.some((id) => kept.results?.includes(id) !== true);
    fill(status, kept.signed_by === null || kept.updated_at === null ? "Not signed."
      : `Signed by ${kept.signed_by} on ${moment(kept.updated_at)}${others ? ", before these results: they are newer" : ""}.`);
  };
  const put = (note: SubjectNote) => guarded(failed, async () => show(await sendJson<SubjectNoteDocument>(pathOf(subject), note, "PUT")));
  show(await getJson<SubjectNoteDocument>(pathOf(subject), signal));
  return h("section", null, h("h2", null, "Notes and signature"), failed,
    h("div", { class: "noted" }, h("label", { for: textId }, "Notes"), text), printed, status,
    h("div", { class: "actions" }, h("button", { onclick: () => void put({ text: text.value }) }, "Keep the notes"),
      h("span", { class: "field" }, h("label", { for: nameId }, "name"), name),
      h("button", { onclick: () => name.value.trim() === "" ? name.focus() : void put({ text: text.value, signed_by: name.value.trim(), results: [...results] }) }, "Sign notes and results")),
    h("p", { class: "note unprinted" }, "Keeping changed notes takes a signature away."));
}
