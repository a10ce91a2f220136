/** Questions in front of the page. The browser keeps the focus inside. */

import { h, newId } from "./dom.ts";

/** Ask something that only yes answers. */
export function confirmed(question: string, yes: string): Promise<boolean> {
  return new Promise((resolve) => {
    const form = shown(question, [], yes, "Keep it", () => "yes", (value) => resolve(value === "yes"));
    form.showModal();
  });
}

/** Ask for the API key until one is given. */
export function askForKeyOnScreen(refused: boolean): Promise<string> {
  return new Promise((resolve) => {
    const id = newId("key");
    const input = h("input", { id, type: "password", autocomplete: "off", required: true, spellcheck: "false" });
    const reason = refused
      ? ["The service does not know this key."]
      : ["This service asks for an API key. Who runs it makes one with ", h("code", null, "scaling-service keys create NAME"), "."];
    const dialog = shown(
      "API key",
      [h("p", null, ...reason), h("label", { for: id }, "Key"), input,
        h("p", { class: "note" }, "It is kept in this tab only, and forgotten when the tab is closed.")],
      "Use it",
      null,
      () => input.value.trim(),
      (value) => resolve(value ?? ""),
    );
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    dialog.showModal();
    input.focus();
  });
}

function shown(
  title: string,
  content: HTMLElement[],
  yes: string,
  no: string | null,
  value: () => string,
  done: (value: string | null) => void,
): HTMLDialogElement {
  const id = newId("dialog");
  let answer: string | null = null;
  const dialog = h(
    "dialog",
    { "aria-labelledby": id },
    h(
      "form",
      {
        method: "dialog",
        onsubmit: (event) => {
          event.preventDefault();
          answer = value();
          dialog.close();
        },
      },
      h("h2", { id }, title),
      ...content,
      h("div", { class: "actions" }, h("button", { class: "main" }, yes),
        no !== null && h("button", { type: "button", onclick: () => dialog.close() }, no)),
    ),
  );
  dialog.addEventListener("close", () => {
    dialog.remove();
    done(answer);
  });
  document.body.append(dialog);
  return dialog;
}
