/** `cohort.json` as far as the page shows it. */

export interface SubjectEntry {
  id: string;
  groups: Record<string, string>;
  status: "done" | "skipped" | "failed";
  reason: string;
  methods: string[];
  left_out: Record<string, string>;
  strides: Record<string, number>;
  wall_s: number;
}

export interface QuantityEntry {
  quantity: string;
  compared: { methods: string[]; subjects: string[]; excluded: Record<string, string> };
  mean: Record<string, number>;
  sd: Record<string, number>;
  values: Record<string, Record<string, number>>;
  friedman: { chi_square: number; p: number; kendall_w: number; significant: boolean;
    pairs: { methods: [string, string]; difference_mean: number; difference_sd: number; p: number; significant: boolean }[] } | null;
  note: string;
}

export interface CurveTest {
  p: number;
  significant: boolean;
  can_decide: boolean;
  clusters: { start_percent: number; end_percent: number; p: number }[];
}

export interface CurveEntry {
  coordinate: string;
  compared: { methods: string[]; subjects: string[] };
  reference: string | null;
  mean_deg: Record<string, number[]>;
  sd_deg: Record<string, number[]>;
  anova: CurveTest | null;
  pairs: { methods: [string, string]; test: CurveTest }[];
  note: string;
}

interface Interval {
  value: number;
  low: number | null;
  high: number | null;
}

export interface AgreementEntry {
  quantity: string;
  method: string;
  reference: string;
  subjects: string[];
  bias_mm: Interval;
  sd_mm: number;
  lower_mm: Interval;
  upper_mm: Interval;
  rmse_mm: number;
  icc_agreement: Interval | null;
}

export const QUANTITIES = [
  ["kinematic_error_mm", "Kinematic error", "mm"],
  ["segment_lengths_mm", "Segment length", "mm"],
  ["knee_axis_deg", "Turn of the knee axis", "deg"],
  ["marker_shift_mm", "Marker shift", "mm"],
  ["from_truth_mm", "Distance from the truth", "mm"],
  ["from_truth_deg", "Distance from the truth", "deg"],
] as const;

export type Statistics = Record<(typeof QUANTITIES)[number][0], QuantityEntry[]> & {
  joint_angles: CurveEntry[];
  agreement: AgreementEntry[];
  opensim_limits: { rms_below_mm: number; max_below_mm: number;
    methods: { method: string; subjects: number; subjects_passed: number; trials: number; trials_passed: number }[] };
  notes: string[];
};

export interface CohortDocument {
  subjects: SubjectEntry[];
  statistics: Statistics;
  notes: string[];
}
