/** How recordings are processed and models fitted, and what is written: the few settings that laboratories change. */

import { box, group, select, type Option } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";

const AXES = ["+x", "-x", "+y", "-y", "+z", "-z"].map((value) => ({ value, text: value }));
const FOUND = { value: "", text: "as found" };

export class Chosen {
  readonly element: HTMLElement;
  private up: string;
  private forward: string;
  private smoothing = "automatic";
  private strategy = "joint";
  private knee = "hinge";
  private readonly tables = new Set<string>();
  private readonly forms = new Set<string>();

  /** `query` may name axes that were chosen while the recordings were looked at. */
  constructor(query: URLSearchParams) {
    this.up = query.get("up") ?? "";
    this.forward = query.get("forward") ?? "";
    this.element = h(
      "details",
      { open: this.up !== "" || this.forward !== "" },
      h("summary", null, "Settings"),
      h(
        "div",
        { class: "actions" },
        select("up", [FOUND, ...AXES], this.up, (value) => void (this.up = value)),
        select("forward", [FOUND, ...AXES], this.forward, (value) => void (this.forward = value)),
        select("smoothing", SMOOTHINGS, this.smoothing, (value) => void (this.smoothing = value)),
        select("fitting", STRATEGIES, this.strategy, (value) => void (this.strategy = value)),
        select("knees", KNEES, this.knee, (value) => void (this.knee = value)),
      ),
      group("Tables of the results", ...boxes(TABLES, this.tables)),
      group("Further forms of scaled models", ...boxes(FORMS, this.forms)),
      h("p", { class: "note" }, "Tables and models lie among the files to take away. Models are written in OpenSim's form in any case."),
      h("p", { class: "note" }, "All settings are described at ", h("a", { href: "/docs" }, "/docs"), "; the page uses their defaults."),
    );
  }

  settings(): Record<string, unknown> {
    return {
      processing: { smoothing: this.smoothing },
      calibration: { strategy: this.strategy, knee: this.knee },
      ...this.directions(),
    };
  }

  /** For requests with defaults of their own: only the axes, and only where they were chosen. */
  axes(): Record<string, unknown> {
    return this.up === "" && this.forward === "" ? {} : { settings: { ...this.directions(), processing: { smoothing: "none" } } };
  }

  /** Which tables are written beside any result. */
  written(): Record<string, string[]> {
    return this.tables.size === 0 ? {} : { tables: [...this.tables] };
  }

  /** Which forms of each model are written beside OpenSim's. */
  exported(): Record<string, string[]> {
    return this.forms.size === 0 ? {} : { export: [...this.forms] };
  }

  private directions(): Record<string, string> {
    return { ...(this.up === "" ? {} : { up: this.up }), ...(this.forward === "" ? {} : { forward: this.forward }) };
  }
}

/** A box for each; what is ticked is kept. */
const boxes = (options: readonly Option[], kept: Set<string>): HTMLElement[] =>
  options.map(({ value, text }) => box(text, false, (checked) => void (checked ? kept.add(value) : kept.delete(value))));

const TABLES = [
  { value: "csv", text: "CSV, for spreadsheets" },
  { value: "parquet", text: "Parquet, for Python and R" },
  { value: "bids", text: "Motion-BIDS, for sharing motions" },
];
const FORMS = [
  { value: "mjcf", text: "MuJoCo (MJCF)" },
  { value: "biomod", text: "biorbd (bioMod)" },
];
const SMOOTHINGS = [
  { value: "automatic", text: "low pass of 10 Hz where the rate allows" },
  { value: "none", text: "none" },
];
const STRATEGIES = [
  { value: "joint", text: "motion and parameters together" },
  { value: "alternating", text: "the paper's loop" },
];
const KNEES = [
  { value: "hinge", text: "hinge" },
  { value: "universal", text: "with inward rotation" },
  { value: "spherical", text: "with varus, too" },
];
