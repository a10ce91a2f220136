/** Numbers, times and names as people read them. */

import type { Correction } from "../api/schema.ts";

const DASH = "–";

/** A number as shown, a dash where there is none. */
export function number(value: number | null | undefined, digits = 1): string {
  return value === null || value === undefined || !Number.isFinite(value) ? DASH : minus(value.toFixed(digits));
}

/** A written number with the sign that is read as minus, and none before a zero. */
export const minus = (text: string): string => text.replace(/^-(?=0(\.0*)?$)/, "").replace(/^-/, "−");

/** A difference as shown, with its sign. */
export function signed(value: number | null | undefined, digits = 1): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = Math.abs(value).toFixed(digits);
  return `${Number(text) === 0 ? "±" : value > 0 ? "+" : "−"}${text}`;
}

/** A number to some figures. */
export function figures(value: number | null | undefined, count = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  return value === 0 ? "0" : minus(String(Number(value.toPrecision(count))));
}

/** A p-value as shown. */
export function chance(p: number | null | undefined): string {
  if (p === null || p === undefined) return DASH;
  if (p < 1e-3) return "< 0.001";
  return p >= 0.01 ? p.toFixed(2) : p.toFixed(3);
}

/** The same in a sentence. */
export const withChance = (p: number | null | undefined): string => (p != null && p < 1e-3 ? "p < 0.001" : `p = ${chance(p)}`);

export const percent = (share: number | null | undefined): string =>
  share === null || share === undefined ? DASH : `${Math.round(100 * share)} %`;

/** The same in a sentence: nothing is all or nothing. */
export const shareInWords = (share: number): string => (share > 0.99 ? "> 99 %" : share < 0.01 ? "< 1 %" : percent(share));

/** Names of OpenSim's models and of the service that are no words, as `scaling_service/core/names.py` has them. */
const SHORT: Record<string, string> = {
  calcn: "heel bone", mtp_angle: "toe angle", arm_flex: "arm flexion", arm_add: "arm adduction", arm_rot: "arm rotation",
  elbow_flex: "elbow flexion", pro_sup: "forearm rotation", wrist_flex: "wrist flexion",
  wrist_dev: "wrist deviation", inter_hip: "distance between the hips",
};

/** A coordinate's, joint's or segment's name for people: `hip_flexion_r` is "hip flexion, right". */
export function words(name: string): string {
  const moved = /^(.+)_t([xyz])$/.exec(name);
  if (moved !== null) return `${words(moved[1] ?? "")} moving along ${moved[2] ?? ""}`;
  const match = /^(.+)_([rl])$/.exec(name);
  if (match === null) return SHORT[name] ?? name.replaceAll("_", " ");
  return `${words(match[1] ?? "")}, ${match[2] === "r" ? "right" : "left"}`;
}

/** A number's name with its unit: `x_mm_per_deg` is "x, mm per deg". */
export const withUnit = (name: string): string =>
  name.replace(/_((?:mm|m|deg|s|kg|N|Nm|hz)(?:_per_.*)?)$/, ", $1").replace(/\bNm\b/, "N m").replace(/\bhz\b/, "Hz").replaceAll("_", " ");

export function plural(count: number, one: string, many = `${one}s`): string {
  return `${count} ${count === 1 ? one : many}`;
}

/** Bytes as people read them. */
export function size(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

const clock = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

export const moment = (iso: string): string => clock.format(new Date(iso));

/** Seconds as people read them. */
export function duration(seconds: number): string {
  if (seconds < 60) return `${seconds.toFixed(seconds < 10 ? 1 : 0)} s`;
  return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}

/** Some names, and how many more there are. */
export function few(names: readonly string[], most = 6): string {
  const more = names.length - most;
  return names.slice(0, most).join(", ") + (more > 0 ? ` and ${more} more` : "");
}

/** What a correction does to labels. */
export function correctionInWords({ labels, from_s, to_s }: Correction): string {
  const span = `from ${from_s.toFixed(2)} to ${to_s.toFixed(2)} s`;
  const pairs = Object.entries(labels);
  const right = new Set(pairs.map(([, name]) => name));
  if (pairs.every(([label]) => right.has(label))) return `exchange ${pairs.map(([label]) => label).join(" and ")} ${span}`;
  return `${pairs.map(([label, name]) => (name === null ? `leave ${label} out` : `take ${label} for ${name}`)).join(", ")} ${span}`;
}

const KINDS: Record<string, string> = {
  scaling: "Comparison of methods",
  "linear-scaling": "Linear scaling",
  "optimised-scaling": "Optimised scaling",
  landmarks: "Landmarks on bones",
  "kinematic-error": "Kinematic error",
  "segment-lengths": "Segment lengths",
  "joint-angles": "Joint angles",
  motion: "Motion with a model used again",
  dynamics: "Residual forces",
  consistent: "Motion that forces agree with",
  discovery: "Search for the missing effect",
  batch: "Cohort",
  "batch-member": "Member of a cohort",
  proof: "File check",
  scene: "Scene",
};

export const kindInWords = (kind: string): string => KINDS[kind] ?? kind.replaceAll("-", " ");
