/** What stands around every view: the name, where one can go, and whether the service answers. */

import { currentKey, forgetKey } from "./api/key.ts";
import { onConnection } from "./api/connection.ts";
import { link } from "./routes.ts";
import { fill, h } from "./ui/dom.ts";
import { choose, theme } from "./ui/theme.ts";

const PLACES = [
  ["subjects", "Subjects"],
  ["jobs", "Jobs"],
  ["cohort", "Cohort"],
] as const;

export interface Shell {
  main: HTMLElement;
  /** Where it is shown what failed beside the view. */
  trouble: HTMLElement;
  /** Mark where one is. */
  at: (part: string) => void;
}

export function shell(): Shell {
  const main = h("main", { id: "main", tabindex: -1 });
  const links = PLACES.map(([name, title]) => h("a", { href: link([name]) }, title));
  const trouble = h("div", { class: "trouble" });
  const lost = h("div", { class: "lost", role: "status", "aria-live": "polite" });
  onConnection((away) => {
    fill(lost, away && "The service does not answer. The page goes on by itself as soon as it is back.");
  });
  document.body.append(
    h("a", { class: "skip", href: "#main", onclick: (event) => toMain(event, main) }, "To the content"),
    h(
      "header",
      null,
      h("a", { class: "brand", href: "#/" }, "scaling-service"),
      h("nav", { "aria-label": "Places" }, ...links),
      h("span", { class: "push" }),
      h("a", { href: "/guide/" }, "Guide"),
      h("a", { href: "/docs" }, "API"),
      keyButton(),
      themeButton(),
    ),
    lost,
    trouble,
    main,
    footer(),
  );
  return { main, trouble, at: (part) => links.forEach((one, place) => mark(one, PLACES[place]?.[0] === part)) };
}

function footer(): HTMLElement {
  const licences = document.querySelector<HTMLLinkElement>("link[rel=license]")?.href ?? null;
  return h("footer", null, "Apache-2.0. ", h("a", { href: licences }, "Licences of what this page is made of"));
}

function mark(element: HTMLElement, present: boolean): void {
  if (present) element.setAttribute("aria-current", "page");
  else element.removeAttribute("aria-current");
}

function toMain(event: Event, main: HTMLElement): void {
  event.preventDefault();
  main.focus();
}

/** Goes from light to dark and back. */
export function themeButton(): HTMLElement {
  const button: HTMLButtonElement = h("button", { class: "plain", onclick: () => {
    choose(theme() === "dark" ? "light" : "dark");
    showTheme();
  } });
  function showTheme(): void {
    button.textContent = theme() === "dark" ? "Light" : "Dark";
    button.setAttribute("aria-label", `Show the page ${theme() === "dark" ? "light" : "dark"}`);
  }
  showTheme();
  return button;
}

function keyButton(): HTMLElement {
  const button: HTMLButtonElement = h("button", { class: "plain", onclick: () => {
    forgetKey();
    location.reload();
  } }, "Forget key");
  const show = (): void => void (button.hidden = currentKey() === null);
  show();
  addEventListener("hashchange", show);
  return button;
}
