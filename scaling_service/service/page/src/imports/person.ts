/** Who was recorded, and the model that is scaled. */

import type { Vocabulary } from "../api/schema.ts";
import { select } from "../ui/choice.ts";
import { h, newId } from "../ui/dom.ts";
import type { Draft } from "./draft.ts";

const SEXES = [{ value: "", text: "not given" }, { value: "F", text: "female" }, { value: "M", text: "male" }];

export function personForm(draft: Draft, { models }: Vocabulary): HTMLElement {
  const { subject, model, bones } = draft.document;
  const known = models.map(({ name, feet }) => ({ value: name, text: feet ? `${name}, with feet` : name }));
  const own = known.some(({ value }) => value === model) ? [] : [{ value: model ?? "", text: model ? `${model} (file)` : "choose" }];
  return h(
    "div",
    { class: "person" },
    h("span", { "data-give": "model" }, select("model", [...own, ...known], model ?? "", (name) => draft.model(name))),
    select("sex", SEXES, subject.sex ?? "", (sex) => draft.person({ sex: sex === "F" || sex === "M" ? sex : undefined } as Partial<typeof subject>)),
    quantity("height", "height, m", subject.height_m, { min: "0.3", max: "2.8", step: "0.001" }, (height_m) => draft.person({ height_m } as Partial<typeof subject>)),
    quantity("mass", "mass, kg", subject.mass_kg, { min: "1", max: "400", step: "0.1" }, (mass_kg) => draft.person({ mass_kg } as Partial<typeof subject>)),
    bones && !bones.segmentation && // a label map's header says how large its voxels are
      select("bones are in", ["mm", "m"].map((value) => ({ value, text: value })), bones.units ?? "mm", (unit) => draft.units(unit === "m" ? "m" : "mm")),
  );
}

function quantity(
  name: string,
  label: string,
  value: number | null | undefined,
  limits: Record<string, string>,
  changed: (value: number | undefined) => void,
): HTMLElement {
  const id = newId("quantity");
  const input: HTMLInputElement = h("input", { id, type: "number", value, ...limits, "data-give": name,
    oninput: () => changed(input.value === "" ? undefined : Number(input.value)) });
  return h("span", { class: "field" }, h("label", { for: id }, label), input);
}
