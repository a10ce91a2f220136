/** Elements. Text only ever goes in as text, so names from files are never read as HTML. */

type Child = Node | string | number | null | undefined | false;
type Listeners = { [Name in keyof HTMLElementEventMap as `on${Name}`]?: (event: HTMLElementEventMap[Name]) => void };
type Attributes = Record<string, string | number | boolean | null | undefined>;

/** An HTML element with attributes, listeners (`onclick`) and children. */
export function h<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  given: (Attributes | Listeners) | null = null,
  ...children: Child[]
): HTMLElementTagNameMap[Tag] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(given ?? {})) {
    if (typeof value === "function") {
      element.addEventListener(name.slice(2), value as EventListener);
    } else {
      setAttribute(element, name, value);
    }
  }
  fill(element, ...children);
  return element;
}

/** What may be copied, followed or chosen keeps its characters. */
const VERBATIM = new Set(["PRE", "CODE", "OPTION", "TEXTAREA", "A"]);

const SVG = "http://www.w3.org/2000/svg";

/** An SVG element with attributes and children. */
export function svg<Tag extends keyof SVGElementTagNameMap>(
  tag: Tag,
  given: Attributes = {},
  ...children: Child[]
): SVGElementTagNameMap[Tag] {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(given)) setAttribute(element, name, value);
  element.append(...wanted(children, true));
  return element;
}

/** Replace all that an element holds. */
export function fill(element: Element, ...children: Child[]): void {
  element.replaceChildren(...wanted(children, !VERBATIM.has(element.tagName)));
}

/** Set custom properties of styles, which styles sheets then use. */
export function vary<Styled extends HTMLElement | SVGElement>(element: Styled, values: Record<string, string>): Styled {
  for (const [name, value] of Object.entries(values)) element.style.setProperty(name, value);
  return element;
}

let count = 0;

/** An id that no other element of the page has. */
export function newId(stem: string): string {
  count += 1;
  return `${stem}-${count}`;
}

function setAttribute(element: Element, name: string, value: Attributes[string]): void {
  if (value === null || value === undefined || value === false) return;
  element.setAttribute(name, value === true ? "" : String(value));
}

function wanted(children: Child[], prose: boolean): (Node | string)[] {
  return children
    .filter((child) => child !== null && child !== undefined && child !== false)
    .map((child) => (child instanceof Node ? child : prose ? withMinus(String(child)) : String(child)));
}

/** A number's sign as a minus, also within the sentences of the service, which write a hyphen. */
function withMinus(text: string): string {
  return text.replace(/(?<=^|[\s(±])-(?=\d)/g, "−");
}
