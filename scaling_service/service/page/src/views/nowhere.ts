import { h } from "../ui/dom.ts";
import type { View } from "./view.ts";

/** What an address leads to that names no place. */
export const nowhere: View = ({ main }) => {
  main.append(h("h1", null, "There is nothing here"), h("p", null, h("a", { href: "#/" }, "To the beginning")));
};
