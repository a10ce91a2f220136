/** What is played back: bodies and trials, with arrays that lie in files of their own. */

/** Little-endian float32, frame after frame; NaN where nothing is known. */
export interface Stored {
  file: string;
  shape: number[];
  unit: string;
  /** Every `step`-th frame, or the most of as many, of what is long. */
  overview: { file: string; shape: number[]; step: number } | null;
}

export type Triple = [number, number, number];

export interface Plate {
  name: string;
  corners_m: Triple[] | null;
  peak_N: number | null;
  /** Who stood on it and when. */
  loaded_by: string[];
}

export interface BodyDocument {
  name: string;
  bones: string | null;
  segments: { name: string; parent: string | null; shape: "image" | "simple" | "none" }[];
  markers: { name: string; segment: string; xyz_m: Triple; anatomical: boolean }[];
  centres: { name: string; segment: string; xyz_m: Triple }[];
  axes: { segment: string; ends_m: [Triple, Triple] }[];
}

export interface MotionDocument {
  poses: Stored;
  /** Where the model's markers are, where they glide on their segments; in the order of the labels. */
  placed: Stored | null;
  errors: Stored;
  coordinates: { name: string; unit: string; estimated: boolean }[];
  angles: Stored;
}

export interface TrialDocument {
  name: string;
  role: "calibration" | "evaluation";
  frames: number;
  rate_hz: number;
  start_s: number;
  labels: string[];
  measured: Stored;
  motions: Record<string, MotionDocument>;
  plates: Plate[];
  force: Stored | null;
  centre_of_pressure: Stored | null;
}

export interface CycleTest {
  p: number | null;
  can_decide: boolean;
  differ_percent: [number, number][];
}

export interface Cycle extends CycleTest {
  cycles: number;
  mean_deg: Record<string, number[]>;
  sd_deg: Record<string, number[]>;
  pairs: Record<string, CycleTest>;
}

export interface GaitDocument {
  trials: string[];
  held_out: boolean;
  reason: string;
  reference: string;
  angles: Record<string, Cycle>;
}

export interface SceneDocument {
  subject: string;
  bodies: BodyDocument[];
  trials: TrialDocument[];
  gait: GaitDocument | null;
}
