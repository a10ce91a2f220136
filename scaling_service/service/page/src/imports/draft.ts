/** A subject's document while it is corrected: what each file is for, who it is, which label is which marker. */

import type { Bones, Correction, GaitEventEntry, SubjectDocument } from "../api/schema.ts";

/** What a file is for, as the proof names it, such as `calibration` or `bones.femur_r`. */
export type Role = string;

export class Draft {
  private readonly roles = new Map<string, Set<Role>>();
  private lastModel: string;

  /** @param changed called after each change. */
  constructor(
    readonly document: SubjectDocument,
    private readonly changed: () => void,
  ) {
    const { trials, forces, bones } = document;
    this.give(trials?.static, "static");
    for (const name of trials?.calibration ?? []) this.give(name, "calibration");
    for (const name of trials?.evaluation ?? []) this.give(name, "evaluation");
    for (const [trial, name] of Object.entries(forces ?? {})) this.give(name, `forces.${trial}`);
    for (const [bone, name] of Object.entries(bones ?? {})) if (bone !== "units") this.give(name, `bones.${bone}`);
    for (const field of ["model", "marker_set", "scale_setup", "image_markers"] as const) this.give(document[field], field);
    this.lastModel = this.chosenModel();
  }

  /** A built-in model or a file; empty where none is chosen. */
  chosenModel(): string {
    const file = [...this.roles].find(([, roles]) => roles.has("model"))?.[0];
    const { model } = this.document;
    return file ?? (/\.osim$/i.test(model ?? "") ? "" : model ?? "");
  }

  /** The role of a file; `static+calibration` where a recording has both. */
  roleOf(file: string): Role {
    return [...(this.roles.get(file) ?? [])].join("+");
  }

  /** Give a file a role; roles that only one file can have are taken from the others. */
  assign(file: string, role: Role): void {
    const wanted = new Set(role.split("+").filter((one) => one !== ""));
    for (const one of wanted) {
      if (one === "calibration" || one === "evaluation") continue;
      for (const others of this.roles.values()) others.delete(one);
    }
    this.roles.set(file, wanted);
    this.change();
  }

  person(values: Partial<SubjectDocument["subject"]>): void {
    const given = Object.entries({ ...this.document.subject, ...values }).filter(([, value]) => value !== undefined);
    this.document.subject = Object.fromEntries(given) as unknown as SubjectDocument["subject"];
    this.change();
  }

  /** Choose a built-in model in place of a file. */
  model(name: string): void {
    for (const roles of this.roles.values()) roles.delete("model");
    this.document.model = name;
    this.change();
  }

  units(units: NonNullable<Bones["units"]>): void {
    this.document.bones = { ...this.document.bones, units };
    this.change();
  }

  /** Take a label for a model marker; null: leave it to names and aliases. */
  marker(marker: string, label: string | null): void {
    const kept = Object.entries(this.document.markers ?? {}).filter(([name, one]) => name !== marker && one !== label);
    this.document.markers = Object.fromEntries(label === null ? kept : [...kept, [marker, label]]);
    if (label !== null) this.extra(label, null);
    this.change();
  }

  /** Use a further label on a segment, or not. */
  extra(label: string, segment: string | null): void {
    const kept = Object.entries(this.document.extra_markers ?? {}).filter(([name]) => name !== label);
    this.document.extra_markers = Object.fromEntries(segment === null ? kept : [...kept, [label, segment]]);
    this.change();
  }

  /** Exchange labels of a recording for a while, beside what is exchanged already; null: leave it as it was. */
  correct(file: string, correction: Correction | null): void {
    const { [file]: before = [], ...others } = this.document.corrections ?? {};
    this.document.corrections = correction === null ? others : { ...others, [file]: [...before, correction] };
    this.change();
  }

  /** Events of gait of a recording, in place of what is found; null: what is found. */
  events(file: string, all: GaitEventEntry[] | null): void {
    const { [file]: _, ...others } = this.document.events ?? {};
    this.document.events = all === null ? others : { ...others, [file]: all };
    this.change();
  }

  /** The document as it is to be given to the service. */
  finished(): SubjectDocument {
    const with_ = (role: Role): string[] => [...this.roles].filter(([, roles]) => roles.has(role)).map(([file]) => file);
    const below = (stem: string): Record<string, string> =>
      Object.fromEntries([...this.roles].flatMap(([file, roles]) =>
        [...roles].filter((role) => role.startsWith(`${stem}.`)).map((role) => [role.slice(stem.length + 1), file])));
    const bones = below("bones");
    const { bones: before } = this.document;
    const found: Record<string, unknown> = {
      subject: this.document.subject,
      model: this.chosenModel(),
      marker_set: with_("marker_set")[0],
      scale_setup: with_("scale_setup")[0],
      markers: this.document.markers,
      extra_markers: this.document.extra_markers,
      trials: { static: with_("static")[0] ?? null, calibration: with_("calibration"), evaluation: with_("evaluation") },
      forces: below("forces"),
      corrections: this.document.corrections,
      mirrored: this.document.mirrored,
      events: this.document.events,
      bones: Object.keys(bones).length === 0 ? undefined : { units: before?.units ?? "mm", ...bones },
      image_markers: with_("image_markers")[0],
      sizes: this.document.sizes,
    };
    return Object.fromEntries(Object.entries(found).filter(([, value]) => !isEmpty(value))) as unknown as SubjectDocument;
  }

  private give(file: string | null | undefined, role: Role): void {
    if (file === null || file === undefined) return;
    this.roles.set(file, (this.roles.get(file) ?? new Set()).add(role));
  }

  private change(): void {
    const model = this.chosenModel();
    if (model !== this.lastModel) {
      this.document.markers = {}; // they name markers and segments of the model before
      this.document.extra_markers = {};
      this.lastModel = model;
    }
    this.changed();
  }
}

function isEmpty(value: unknown): boolean {
  if (value === undefined || value === null || value === "") return true;
  return typeof value === "object" && Object.keys(value).length === 0;
}
