/** A labelled list to choose from, and groups of boxes. */

import { h, newId } from "./dom.ts";

export interface Option {
  value: string;
  text: string;
}

export function select(
  label: string,
  options: readonly Option[],
  chosen: string,
  changed: (value: string) => void,
): HTMLElement {
  const id = newId("choice");
  const list: HTMLSelectElement = h(
    "select",
    { id, onchange: () => changed(list.value) },
    ...options.map(({ value, text }) => h("option", { value, selected: value === chosen }, text)),
  );
  return h("span", { class: "field" }, h("label", { for: id }, label), list);
}

export function box(label: Node | string, checked: boolean, changed: (checked: boolean) => void): HTMLElement {
  const input: HTMLInputElement = h("input", { type: "checkbox", checked, onchange: () => changed(input.checked) });
  return h("label", { class: "box" }, input, label);
}

export function group(legend: string, ...boxes: HTMLElement[]): HTMLElement {
  return h("fieldset", { class: "group" }, h("legend", null, legend), ...boxes);
}
