/** What travels between the service and this page; the service's OpenAPI document describes each. */

export interface FileEntry {
  name: string;
  size: number;
  sha256: string;
}

export interface SubjectSummary {
  id: string;
  created_at: string;
  updated_at: string;
  revision: number;
}

export interface SubjectDocument {
  subject: { id: string; sex?: "F" | "M"; height_m?: number; mass_kg?: number };
  model: string;
  marker_set?: string;
  scale_setup?: string;
  markers?: Record<string, string>;
  extra_markers?: Record<string, string>;
  trials: { static?: string | null; calibration?: string[]; evaluation?: string[] };
  forces?: Record<string, string>;
  bones?: Record<string, string>;
  image_markers?: string;
  sizes?: Record<string, number>;
}

export interface SubjectDetail extends SubjectSummary {
  document: SubjectDocument;
  files: FileEntry[];
}

export type State = "waiting" | "queued" | "running" | "cancelling" | "done" | "failed" | "cancelled";

export interface Failure {
  kind: string;
  problem: string;
  file: string | null;
  field: string | null;
  remedy: string | null;
}

export interface Job {
  id: string;
  kind: string;
  state: State;
  progress: { what: string; share: number };
  attempt: number;
  revision: number;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
  updated_at: string;
  code_version: string;
  failure: Failure | null;
  links: Record<string, string>;
}

export interface Page<Item> {
  items: Item[];
  next: string | null;
}

export interface Specification {
  kind: string;
  request: Record<string, unknown>;
}

/** What was asked for, and how it was computed. */
export interface Origin {
  specification: Specification;
  provenance: Record<string, unknown> | null;
}

/** Whether nothing more happens to a job by itself. */
export function isOver(job: Job): boolean {
  return job.state === "done" || job.state === "failed" || job.state === "cancelled";
}
