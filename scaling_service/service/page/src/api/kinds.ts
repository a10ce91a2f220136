/** Under which route each kind of job is asked for. */

export const ROUTES: Record<string, string> = {
  scaling: "comparisons",
  "linear-scaling": "scalings/linear",
  "optimised-scaling": "scalings/optimised",
  landmarks: "scalings/mesh-landmarks",
  "kinematic-error": "comparisons/kinematic-error",
  "segment-lengths": "comparisons/segment-lengths",
  "joint-angles": "comparisons/joint-angles",
  motion: "motions",
  dynamics: "dynamics",
  consistent: "consistent-motions",
  discovery: "discoveries",
  batch: "batches",
  proof: "proofs",
};
