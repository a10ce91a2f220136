/** Results of jobs as far as the page shows them; the service's OpenAPI document describes all. */

export interface TrialError {
  role: "calibration" | "evaluation";
  mean: number;
  sd: number;
  rms: number;
  max: number;
  anatomical_mean: number | null;
  tracking_mean: number | null;
  frames: number;
  per_marker: Record<string, number>;
}

export interface FittedParameter {
  name: string;
  value: number;
  unit: "m" | "rad" | "1";
  sd: number | null;
  at_bound: boolean;
  identifiable: boolean;
}

export interface MethodResult {
  method: string;
  kinematic_error_mm: Record<string, TrialError>;
  fitted_mean_mm: number | null;
  held_out_mean_mm: number | null;
  held_out_ratio: number | null;
  segment_lengths_mm: Record<string, number>;
  length_estimates?: Record<string, { sd_mm: number; measured: number; others: number; expected: number }>;
  joint_centres_mm: Record<string, { frame: string; xyz: [number, number, number] }>;
  knee_axis_deg: Record<string, { x: number; y: number }>;
  marker_shift_mm: Record<string, number>;
  parameters: FittedParameter[];
  warnings: string[];
}

export type Level = "good" | "fair" | "poor" | "unknown";

export interface Verdict {
  method: string;
  strength: "decided" | "leaning" | "undecided";
  headline: string;
  why: string[];
  trust: { topic: string; level: Level; text: string }[];
}

export interface RepairNote {
  what: string;
  where: string;
  detail: string;
  frames: number;
}

export interface Provenance {
  code_version: string;
  subject: string;
  input_hashes: Record<string, string>;
  markers_used: Record<string, string[]>;
  repairs: Record<string, RepairNote[]>;
}

export interface ComparisonDocument extends Provenance {
  verdict: Verdict | null;
  methods: Record<string, MethodResult>;
  warnings: string[];
  truth: { segment_lengths_mm: Record<string, number>; errors: Record<string, Record<string, number>> } | null;
}

/** All keys, in the order in which they first appear. */
export function union(all: readonly Record<string, unknown>[]): string[] {
  return [...new Set(all.flatMap((one) => Object.keys(one)))];
}
