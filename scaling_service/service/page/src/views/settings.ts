/** How recordings are processed and models fitted: the few settings that laboratories change. */

import { select } from "../ui/choice.ts";
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

  private directions(): Record<string, string> {
    return { ...(this.up === "" ? {} : { up: this.up }), ...(this.forward === "" ? {} : { forward: this.forward }) };
  }
}

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
