/** Residual forces against the published limits, and what errors of measurement explain of them. */

import type { DynamicsDocument, TrialDynamicsDocument } from "../api/schema.ts";
import { bullets, callout, folded } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { figures, number, words } from "../ui/words.ts";
import { residualCurves } from "./residualcurves.ts";

export async function residuals(document: DynamicsDocument, job: string, signal: AbortSignal, place: HTMLElement): Promise<void> {
  const curves = await residualCurves(document, job, signal);
  if (signal.aborted) return;
  place.append(callout(sentence(document.headline ?? ""), document.tone ?? "plain", h("p", null, document.verdict)), gates(document), curves, rms(document), uncertainty(document), loads(document));
  const warnings = [...document.warnings, ...Object.values(document.trials).flatMap((trial) => trial.warnings)];
  if (warnings.length > 0) place.append(folded("Notes", bullets([...new Set(warnings)])));
}

const columns = (document: DynamicsDocument): { title: string }[] =>
  Object.entries(document.trials).map(([name, trial]) => ({ title: `${name}${trial.role === "evaluation" ? " (held out)" : ""}` }));

const SIX = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"] as const;

const trialsOf = (document: DynamicsDocument): TrialDynamicsDocument[] => Object.values(document.trials);

export function gates(document: DynamicsDocument): HTMLElement {
  const trials = trialsOf(document);
  const rows = (trials[0]?.gates ?? []).map((gate, k) => [
    cell(`${gate.source}: ${gate.name}, ${gate.unit}`),
    ...trials.map((trial) => {
      const found = trial.gates[k];
      if (found === undefined) return cell("–", null);
      const shown = `${number(found.value, 0)} (${number(found.limit, 0)}) ${found.passed ? "kept" : "broken"}`;
      return cell(shown, found.value, found.passed ? "good" : "poor");
    }),
  ]);
  return table({
    caption: "Residuals against published limits: value (limit)",
    name: "gates",
    columns: [{ title: "limit" }, ...columns(document)],
    rows,
    note: "Hicks et al. 2015, and OpenSim's simulation checklist, which holds for walking. Keeping them is necessary, not sufficient.",
  });
}

function rms(document: DynamicsDocument): HTMLElement {
  const trials = trialsOf(document);
  return table({
    caption: "RMS of the residual",
    name: "residual_rms",
    columns: [{ title: "component" }, ...columns(document)],
    rows: [
      ...SIX.map((name) => [cell(componentInWords(name)), ...trials.map((trial) => cell(number(trial.residual_rms[name]), trial.residual_rms[name]))]),
      [cell("frames that count"), ...trials.map((trial) => cell(String(trial.frames), trial.frames))],
      [cell("frames left out"), ...trials.map((trial) => cell(String(trial.left_out), trial.left_out))],
    ],
  });
}

function uncertainty(document: DynamicsDocument): HTMLElement {
  const rows = Object.entries(document.trials).flatMap(([name, trial]) =>
    SIX.map((component, k) => {
      const [dr, total] = [trial.dr[k] ?? NaN, trial.uncertainty.total[k] ?? NaN];
      const blamed = trial.calibration_supported[k] === true;
      return [
        cell(name),
        cell(component.split("_")[0] ?? ""),
        cell(figures(100 * dr), dr),
        cell(figures(100 * (trial.uncertainty.kinematic[k] ?? NaN)), trial.uncertainty.kinematic[k]),
        cell(figures(100 * (trial.uncertainty.plate[k] ?? NaN)), trial.uncertainty.plate[k]),
        cell(figures(100 * total), total),
        cell(blamed ? "inertia may be blamed" : "measurement explains it", undefined, blamed ? "fair" : "good"),
      ];
    }),
  );
  return table({
    caption: "What errors of measurement explain, % of body weight (moments: × height)",
    name: "residual_uncertainty",
    columns: ["trial", "", "residual", "by motion", "by plates", "together", "so"].map((title) => ({ title: title || "component" })),
    rows,
    filter: true,
    note: "Muller et al. 2017. Where the residual does not exceed its uncertainty, the recordings cannot tell the person's inertia.",
  });
}

function loads(document: DynamicsDocument): HTMLElement {
  const rows = Object.entries(document.trials).flatMap(([name, trial]) =>
    Object.entries(trial.joint_loads).map(([coordinate, load]) => [
      cell(words(coordinate)), cell(name), cell(load.unit), cell(number(load.peak), load.peak), cell(number(load.rms), load.rms)]));
  return folded("Joint loads", table({
    caption: "Joint loads",
    name: "joint_loads",
    columns: ["coordinate", "trial", "unit", "peak", "RMS"].map((title) => ({ title })),
    rows,
    filter: true,
  }));
}

const componentInWords = (name: string): string => name.replace("_", ", ").replace("Nm", "N m");
