/** What the service found in a subject's files before anything is computed. */

import type { Told } from "../api/problem.ts";
import type { Plate, Stored, Triple } from "../scene/documents.ts";
import type { SubjectDocument } from "../api/documents.ts";

export interface ProblemEntry extends Told {
  severity: "error" | "warning";
}

export interface Axes {
  up: string;
  forward: string;
  sure: boolean;
  given: boolean;
  why: string[];
  R_new_old: Triple[];
}

export type FileKind = "recording" | "forces" | "model" | "mesh" | "image_markers" | "setup" | "subject" | "other";

export interface FileRole {
  name: string;
  kind: FileKind;
  role: string | null;
  named: boolean;
  why: string;
  problem: ProblemEntry | null;
}

export interface LabelEntry {
  label: string;
  seen: number;
  /** First and last frame of each gap. */
  gaps: [number, number][];
  longest_gap_s: number;
  computed: boolean;
}

export interface RecordingProof {
  name: string;
  file: string;
  format: string;
  unit: string;
  rate_hz: number;
  frames: number;
  start_s: number;
  axes: Axes;
  walked_m: number;
  direction: Triple | null;
  labels: LabelEntry[];
  markers: Stored;
  plates: Plate[];
  forces_from: string | null;
  force: Stored | null;
  centre_of_pressure: Stored | null;
  repairs: { what: string; where: string; detail: string; frames: number }[];
  problems: ProblemEntry[];
}

export interface MarkerProof {
  marker: string;
  segment: string;
  anatomical: boolean;
  label: string | null;
  confidence: number;
  why: string;
  source: "document" | "laboratory" | "name" | "place" | null;
  recordings: string[];
  others: { label: string; confidence: number; why: string }[];
}

export interface MarkerSet {
  name: string;
  title: string;
  share: number;
  lacks: string[];
  additions: string[];
}

export interface Sizes {
  height_m: number | null;
  mass_kg: number | null;
  sex: "F" | "M" | null;
  sizes_mm: Record<string, number>;
  source: string[];
}

export interface ProofDocument {
  subject: string;
  model: string;
  model_why: string | null;
  axes: Axes | null;
  files: FileRole[];
  recordings: RecordingProof[];
  marker_set: MarkerSet | null;
  /** What the markers that are there mean for each method. */
  consequences: string[];
  sizes: Sizes | null;
  markers: MarkerProof[];
  unused_labels: string[];
  extra_markers: { label: string; segment: string | null; spread_mm: number | null }[];
  proposal: SubjectDocument | null;
  problems: ProblemEntry[];
}
