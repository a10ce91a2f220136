/** `discovery.json` as far as the page shows it. */

export interface Placed {
  kind: string;
  where: string[];
  driver: string[];
  trials: string[] | null;
  note: string;
}

export type Observable = "marker" | "force" | "moment";

export interface Disagreement {
  where: string;
  observable: Observable;
  unit: string;
  rms: number;
  floor: number | null;
  share: number | null;
  p: number | null;
  when: string;
  along: string;
}

export interface Quantity {
  value: number | [number, number, number];
  sd: number | null;
}

export interface Effect extends Placed {
  name: string;
  parameters: Record<string, Quantity>;
  smallest_nameable: Record<string, number>;
  confusable_with: Placed[];
  would_separate: string | null;
  evidence: { gain_held_out: number | null; p_held_out: number | null; p_family_wise: number | null; by_blocks: boolean };
}

export interface LevelOf {
  before: number | null;
  after: number | null;
  floor: number | null;
  ceiling: number | null;
  low: number | null;
  high: number | null;
}

export interface Gap {
  whitened: LevelOf | null;
  markers_mm: LevelOf | null;
  force_N: LevelOf | null;
  moment_Nm: LevelOf | null;
  places: Record<string, LevelOf & { unit: string }>;
}

export interface DiscoveryDocument {
  subject: string;
  verdict: "found" | "nothing" | "unexplained";
  reason: string;
  disagreements: Disagreement[];
  effects: Effect[];
  gap: { fit: Gap; held_out: Gap };
  tried: (Placed & { gain: number | null })[];
  unexplained: { where: string[]; observable: Observable; unit: string; law: string; rms: number; floor: number | null }[];
  start: string;
  fitted_trials: string[];
  held_out_trials: string[];
  notes: string[];
}

/** An effect in a line: what, where, along with what, in which recording. */
export function placed({ kind, where, driver, trials, note }: Placed): string {
  const following = driver.length === 0 ? "" : ` with ${driver.join(", ")}`;
  return `${kind.replaceAll("_", " ")} at ${where.join(", ")}${following}${trials === null ? "" : ` in ${trials.join(", ")}`}${note === "" ? "" : ` (${note})`}`;
}
