/** `dynamics.json` as far as the page shows it. Six numbers stand for fx, fy, fz, mx, my, mz. */

export const SIX = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"] as const;

export interface Gate {
  name: string;
  source: string;
  value: number;
  limit: number;
  unit: string;
  passed: boolean;
}

export interface TrialDynamics {
  role: "calibration" | "evaluation";
  forces_from: string;
  frames: number;
  left_out: number;
  residual_rms: Record<(typeof SIX)[number], number>;
  dr: number[];
  gates: Gate[];
  joint_loads: Record<string, { unit: string; peak: number; rms: number }>;
  reconstruction_error_mm: number;
  uncertainty: { kinematic: number[]; plate: number[]; total: number[] };
  slopes_per_cm: number[];
  r2: number[];
  calibration_supported: boolean[];
  warnings: string[];
}

export interface DynamicsDocument {
  start: string;
  inertia: string;
  mass_kg: number;
  height_m: number;
  trials: Record<string, TrialDynamics>;
  verdict: string;
  warnings: string[];
}
