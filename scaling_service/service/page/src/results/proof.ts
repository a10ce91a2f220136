/** A proof is shown where the files are corrected. */

import { toSubject } from "../routes.ts";
import type { ResultView } from "./result.ts";

export const proof: ResultView = ({ request: { subject } }) => {
  if (typeof subject === "string") location.hash = toSubject(subject, "import");
};
