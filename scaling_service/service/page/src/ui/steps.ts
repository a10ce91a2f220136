/** Steps beside each other, one of which is seen; what is typed in the others stays. */

import { note } from "../routes.ts";
import { h } from "./dom.ts";

interface Step {
  name: string;
  title: string;
  panel: HTMLElement[];
}

export class Steps {
  readonly links: HTMLElement;
  readonly panels: HTMLElement[];
  private readonly buttons: HTMLElement[];

  /** @param shown called with the step that is shown. */
  constructor(
    label: string,
    private readonly steps: readonly Step[],
    chosen: string,
    private readonly shown: (name: string) => void,
  ) {
    this.panels = steps.map(({ panel }) => h("div", null, ...panel));
    this.buttons = steps.map(({ name, title }, k) => h("button", { onclick: () => {
      this.show(name);
      this.links.scrollIntoView({ block: "start" });
    } }, `${k + 1} ${title}`));
    this.links = h("nav", { class: "steps", "aria-label": label }, ...this.buttons);
    this.show(steps.some(({ name }) => name === chosen) ? chosen : (steps[0]?.name ?? ""));
  }

  show(name: string): void {
    this.steps.forEach((step, k) => {
      const present = step.name === name;
      const [panel, button] = [this.panels[k], this.buttons[k]];
      if (panel !== undefined) panel.hidden = !present;
      if (present) button?.setAttribute("aria-current", "step");
      else button?.removeAttribute("aria-current");
    });
    if (location.hash.includes("step=") || name !== this.steps[0]?.name) note({ step: name });
    this.shown(name);
  }

  /** Go to where something is given. */
  give(what: string): void {
    const step = this.panels.findIndex((panel) => panel.querySelector(`[data-give~="${CSS.escape(what)}"]`) !== null);
    const target = this.panels[step]?.querySelector<HTMLElement>(`[data-give~="${CSS.escape(what)}"]`);
    this.show(this.steps[step]?.name ?? "");
    target?.scrollIntoView({ block: "center" });
    (target?.matches("input, select, button") === true ? target : target?.querySelector<HTMLElement>("input:not(.sr), select, button"))?.focus();
  }
}
