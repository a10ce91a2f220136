/** Inertia that was identified from the forces: what moved, and what it explains on unseen recordings. */

import type { IdentificationDocument } from "../api/schema.ts";
import { bullets, callout } from "../ui/blocks.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { figures, number, signed, words } from "../ui/words.ts";

const SIX = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"] as const;

export function inertia(found: IdentificationDocument, place: HTMLElement): void {
  const [before, after] = found.total_mass_kg;
  const mass = `Total mass ${number(before)} kg${Math.abs(after - before) < 0.05 ? "" : `, now ${number(after)} kg`}`;
  place.append(callout(sentence(found.headline ?? ""), found.tone ?? "plain", bullets([sentence(mass), ...found.warnings.map(sentence)])), fits(found), moved(found), combinations(found));
}

function fits({ trials }: IdentificationDocument): HTMLElement {
  return table({
    caption: "RMS error of the ground wrench",
    name: "inertia_wrench",
    columns: ["recording", "used", "inertia", ...SIX.map((name) => name.replace("_", ", ").replace("Nm", "N m"))].map((title) => ({ title })),
    rows: Object.entries(trials).flatMap(([name, fit]) => (["before", "after"] as const).map((when) => [
      cell(name), cell(fit.held_out ? "held out" : "used to fit"), cell(when), ...SIX.map((one) => cell(number(fit[when][one]), fit[when][one]))])),
  });
}

function moved({ parameters }: IdentificationDocument): HTMLElement {
  return table({
    caption: "Inertial parameters, what moved most first",
    name: "inertia",
    columns: ["number", "before", "after", "prior SD", "SD", "moved, prior SD", "determined"].map((title) => ({ title })),
    rows: [...parameters].sort((a, b) => Math.abs(b.moved) - Math.abs(a.moved)).map((one) => [
      cell(`${words(one.segment)}: ${one.quantity}, ${one.unit}`), ...[one.before, one.after, one.prior_sd, one.sd].map((value) => cell(figures(value), value)),
      cell(signed(one.moved, 2), one.moved), cell(one.identifiable ? "yes" : "no", undefined, one.identifiable ? "good" : "unknown")]),
    filter: true,
    note: "Centres of mass in the segment's frame, moments of inertia about the centre of mass. Determined: the recordings say more about this number alone than the tables do.",
  });
}

function combinations({ combinations: all }: IdentificationDocument): HTMLElement {
  return table({
    caption: "Combinations that the recordings determine, best first",
    name: "inertia_combinations",
    columns: [{ title: "largest parts" }, { title: "information" }, { title: "moved" }, { title: "SD" }],
    rows: all.map((one) => [cell(one.parts.map(({ weight, segment, quantity }) => `${signed(weight, 2)} ${words(segment)}: ${quantity}`).join(", ")),
      cell(figures(one.gain), one.gain), cell(signed(one.moved, 2), one.moved), cell(number(one.sd, 2), one.sd)]),
    note: "In units of the prior's SD; information over that of the prior. S: second moment of the mass about its centre.",
  });
}
