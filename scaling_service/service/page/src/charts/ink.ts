/** The colours of a figure in the present theme. */

import { HEAT_DARK, HEAT_LIGHT, MEASURED_DARK, MEASURED_LIGHT } from "../ui/palette.ts";
import type { Theme } from "../ui/theme.ts";

export interface Ink {
  text: string;
  quiet: string;
  line: string;
  paper: string;
  /** What was measured, and the model as nothing of the methods. */
  measured: string;
  heat: string[];
}

const LIGHT: Ink = {
  text: "#1f2933", quiet: "#52606d", line: "#dfe4ea", paper: "#ffffff", measured: MEASURED_LIGHT, heat: HEAT_LIGHT,
};
const DARK: Ink = {
  text: "#e8ecf0", quiet: "#a9b4c0", line: "#333c46", paper: "#14181d", measured: MEASURED_DARK, heat: HEAT_DARK,
};

export const inkOf = (theme: Theme): Ink => (theme === "dark" ? DARK : LIGHT);

/** Without quotation marks: they would break the attributes of saved SVG. */
export const FONT = "system-ui, -apple-system, Roboto, sans-serif";
