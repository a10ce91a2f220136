/** What travels between service and page, made from the OpenAPI document by schema.py. */

/** Kind of job to its route. */
export const ROUTES: Record<string, string> = {
  "batch": "batches",
  "consistent": "consistent-motions",
  "discovery": "discoveries",
  "dynamics": "dynamics",
  "proof": "proofs",
  "landmarks": "scalings/mesh-landmarks",
  "motion": "motions",
  "linear-scaling": "scalings/linear",
  "optimised-scaling": "scalings/optimised",
  "scaling": "comparisons",
  "kinematic-error": "comparisons/kinematic-error",
  "segment-lengths": "comparisons/segment-lengths",
  "joint-angles": "comparisons/joint-angles"
};

export interface AgreementEntry {
  quantity: string;
  method: string;
  reference: string;
  subjects: Array<string>;
  excluded: Array<string>;
  bias_mm: Interval;
  sd_mm: number;
  lower_mm: Interval;
  upper_mm: Interval;
  rmse_mm: number;
  icc_agreement: Interval | null;
  icc_consistency: Interval | null;
  confidence: number;
}

export interface AngleDifference {
  methods: [string, string];
  frames: number;
  rms_deg: number | null;
  mean_deg: number | null;
  largest_deg: number | null;
}

export interface AngleEntry {
  mean_deg: Record<string, number | null>;
  range_deg: Record<string, number | null>;
  pairs: Array<AngleDifference>;
}

export interface ArrayEntry {
  file: string;
  shape: Array<number>;
  unit: string;
  overview: Overview | null;
}

export interface AxesEntry {
  up: string;
  forward: string;
  sure: boolean;
  given: boolean;
  why: Array<string>;
  R_new_old: Array<[number, number, number]>;
}

export interface AxisEntry {
  segment: string;
  ends_m: [[number, number, number], [number, number, number]];
}

export interface BatchRequest {
  tables?: Array<"csv" | "parquet" | "bids">;
  subjects: Array<string>;
  groups?: Record<string, Record<string, string>>;
  methods?: Array<string> | null;
  settings?: Settings;
}

export interface BeliefDocument {
  effect: number;
  member: number;
  sign: number | null;
  size: number | null;
  summary: string;
  cautions: Array<string>;
}

export interface BodyEntry {
  name: string;
  bones: string;
  segments: Array<SegmentEntry>;
  markers: Array<BodyMarker>;
  centres: Array<PlacedEntry>;
  axes: Array<AxisEntry>;
}

export interface BodyMarker {
  name: string;
  segment: string;
  xyz_m: [number, number, number];
  anatomical: boolean;
}

export interface Bones {
  units?: "mm" | "m";
  segmentation?: string | null;
  pelvis?: string | null;
  femur_r?: string | null;
  tibia_r?: string | null;
  femur_l?: string | null;
  tibia_l?: string | null;
  talus_r?: string | null;
  talus_l?: string | null;
}

export interface BonesDocument {
  skin_mm: Record<string, number>;
  expectations: Array<ExpectationDocument>;
  left_out: Array<string>;
  sentences: Array<string>;
}

export interface BothGaps {
  fit: GapDocument;
  held_out: GapDocument;
}

export interface CalibrationSettings {
  strategy?: "joint" | "alternating";
  n_frames?: number;
  length_bound?: number;
  axis_bound_x_deg?: number;
  axis_bound_y_deg?: number;
  marker_bound_m?: number;
  length_sd?: number;
  axis_sd_deg?: number;
  marker_sd_m?: number;
  prior?: boolean;
  loop_tolerance?: number;
  max_loops?: number;
  robust_m?: number | null;
  sizes?: "weighted" | "measured";
  hip_regression?: string;
  hip_centre?: "regression" | "functional";
  knee_axis?: "epicondyles" | "functional";
  scaling?: "uniform" | "per-axis";
  knee?: "hinge" | "universal" | "spherical";
}

export interface Candidate {
  label: string;
  confidence: number;
  why: string;
}

export interface ClinicalCurve {
  mean_deg: Array<number>;
  sd_deg: Array<number> | null;
  n_cycles: number;
}

export interface ClinicalCycle {
  trial: string;
  start_s: number;
  end_s: number;
}

export interface ClinicalDocument {
  reference: string;
  population: string;
  sides: Record<string, ClinicalSide>;
  gps_deg: number | null;
  reference_gvs_deg: Record<string, number>;
  reference_gps_deg: number;
  held_out: boolean;
  left_out: Array<string>;
  doubtful: Array<string>;
  reason: string;
}

export interface ClinicalSide {
  cycles: Array<ClinicalCycle>;
  curves: Record<string, ClinicalCurve>;
  gvs_deg: Record<string, number>;
  gps_deg: number | null;
}

export interface ClusterEntry {
  start_percent: number;
  end_percent: number;
  p: number;
}

export interface CohortDocument {
  schema_version: number;
  kind: "cohort";
  code_version: string;
  cohort: string;
  methods_asked: Array<string> | null;
  settings: Record<string, unknown>;
  seed: number;
  headline: string;
  why: Array<string>;
  subjects: Array<SubjectEntry>;
  statistics: StatisticsDocument;
  notes: Array<string>;
  wall_s: number;
}

export interface CombinationChange {
  parts: Array<CombinationPart>;
  gain: number;
  moved: number;
  sd: number;
}

export interface CombinationPart {
  segment: string;
  quantity: string;
  weight: number;
}

export interface Compared {
  methods: Array<string>;
  subjects: Array<string>;
  excluded: Record<string, string>;
}

export interface ComparisonDocument {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  verdict: VerdictDocument | null;
  methods: Record<string, MethodResult>;
  warnings: Array<string>;
  wall_s: number;
  truth: TruthDocument | null;
  muscles: MuscleDocument | null;
}

export interface ConsistentDocument {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  kind: "consistent";
  headline: string;
  tone: "good" | "fair" | "poor" | "unknown" | "plain";
  start: string;
  inertia: string;
  mass_kg: number;
  trials: Record<string, ConsistentTrial>;
  inertial: Array<InertialEntry>;
  lengths_mm: Record<string, number>;
  lengths_before_mm: Record<string, number>;
  length_factors: Record<string, number>;
  outer_iterations: number;
  converged: boolean;
  history: Array<LoopEntry>;
  warnings: Array<string>;
  files: Array<string>;
  wall_s: number;
}

export interface ConsistentRequest {
  start?: "MB" | "MB_lam" | "MB_am" | "EB" | "EB_am" | "MAP" | "none" | null;
  inertia?: "dumas2007" | "dumas_wojtusch2018" | "deleva1996" | "winter2009" | "model" | null;
  cutoff_hz?: number;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
}

export interface ConsistentTrial {
  held_out: boolean;
  forces_from: string;
  frames: number;
  ground_wrench_rmse: WrenchErrors;
  marker_rms_mm: MarkerErrors;
  weight: number;
}

export interface CoordinateEntry {
  name: string;
  unit: "deg" | "m";
  estimated: boolean;
  range: [number, number] | null;
}

export interface CoordinateSummary {
  mean: number;
  mean_sd: number | null;
  range: number;
}

export interface CoordinateWord {
  name: string;
  unit: "deg" | "m";
}

export interface Correction {
  labels: Record<string, string | null>;
  from_s: number;
  to_s: number;
}

export interface CorrectionEntry {
  file: string;
  labels: Record<string, string>;
  from_s: number;
  to_s: number;
}

export interface CurveEntry {
  coordinate: string;
  compared: Compared;
  strides: Record<string, number>;
  reference: string | null;
  mean_deg: Record<string, Array<number>>;
  sd_deg: Record<string, Array<number>>;
  anova: CurveTestEntry | null;
  pairs: Array<CurvePairEntry>;
  note: string;
}

export interface CurvePairEntry {
  methods: [string, string];
  difference_mean_deg: Array<number>;
  test: CurveTestEntry;
}

export interface CurveTestEntry {
  statistic: Array<number>;
  threshold: number | null;
  p: number;
  alpha: number;
  significant: boolean;
  clusters: Array<ClusterEntry>;
  rearrangements: number;
  exact: boolean;
  can_decide: boolean;
}

export interface CycleEntry {
  cycles: number;
  mean_deg: Record<string, Array<number>>;
  sd_deg: Record<string, Array<number>>;
  p: number | null;
  can_decide: boolean;
  differ_percent: Array<[number, number]>;
}

export interface CycleScene {
  p: number | null;
  can_decide: boolean;
  differ_percent: Array<[number, number]>;
  cycles: number;
  mean_deg: Record<string, Array<number>>;
  sd_deg: Record<string, Array<number>>;
  pairs: Record<string, TestEntry>;
}

export interface DisagreementDocument {
  where: string;
  observable: "marker" | "force" | "moment";
  unit: "1" | "mm" | "N" | "N m";
  rms: number;
  floor: number | null;
  share: number | null;
  p: number | null;
  trials: Record<string, number>;
  when: string;
  along: string;
}

export interface DiscoverRequest {
  start?: "MB" | "MB_lam" | "MB_am" | "EB" | "EB_am" | "MAP" | "none" | null;
  inertia?: "dumas2007" | "dumas_wojtusch2018" | "deleva1996" | "winter2009" | "model" | null;
  cutoff_hz?: number;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
}

export interface DiscoveryDocument {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  verdict: "found" | "nothing" | "unexplained";
  headline: string;
  tone: "good" | "fair" | "poor" | "unknown" | "plain";
  reason: string;
  disagreements: Array<DisagreementDocument>;
  effects: Array<EffectDocument>;
  gap: BothGaps;
  tried: Array<TriedDocument>;
  estimates: Array<EstimateDocument>;
  unexplained: Array<UnexplainedDocument>;
  bones: BonesDocument | null;
  start: string;
  fitted_trials: Array<string>;
  held_out_trials: Array<string>;
  trials_with_forces: Array<string>;
  notes: Array<string>;
  files: Array<string>;
  wall_s: number;
  hidden: Array<HiddenDocument> | null;
}

export interface DynamicsDocument {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  start: string;
  inertia: string;
  mass_kg: number;
  weight: WeightDocument;
  height_m: number;
  trials: Record<string, TrialDynamicsDocument>;
  headline: string;
  tone: "good" | "fair" | "poor" | "unknown" | "plain";
  verdict: string;
  inertial: IdentificationDocument | null;
  warnings: Array<string>;
  files: Array<string>;
  wall_s: number;
}

export interface DynamicsRequest {
  start?: "MB" | "MB_lam" | "MB_am" | "EB" | "EB_am" | "MAP" | "none" | null;
  inertia?: "dumas2007" | "dumas_wojtusch2018" | "deleva1996" | "winter2009" | "model" | null;
  cutoff_hz?: number;
  identify?: boolean;
  free_mass?: boolean;
  sides_apart?: boolean;
  despite_verdict?: boolean;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
}

export interface EffectDocument {
  kind: string;
  where: Array<string>;
  driver: Array<string>;
  trials: Array<string> | null;
  note: string;
  name: string;
  carries: boolean;
  parameters: Record<string, QuantityDocument>;
  smallest_nameable: Record<string, number>;
  advice: string;
  confusable_with: Array<PlacedEffect>;
  would_separate: string | null;
  evidence: EvidenceDocument;
  belief: BeliefDocument | null;
}

export interface EstimateDocument {
  kind: string;
  where: Array<string>;
  driver: Array<string>;
  trials: Array<string> | null;
  note: string;
  parameters: Record<string, QuantityDocument>;
}

export interface EventProof {
  side: "r" | "l";
  kind: "strike" | "off";
  time_s: number;
  source: "document" | "file" | "plates";
}

export interface EvidenceDocument {
  gain_held_out: number | null;
  log_odds: number | null;
  p_family_wise: number | null;
  by_blocks: boolean;
  summary: string;
}

export interface ExampleList {
  subjects: Array<string>;
}

export interface ExpectationDocument {
  coordinate: string;
  at_rest_deg: number;
  follows: Array<string>;
  sd_deg: number;
  source: string;
}

export interface ExtraMarker {
  label: string;
  segment: string | null;
  confidence: number;
  why: string;
}

export interface Failure {
  kind: string;
  problem: string;
  file: string | null;
  field: string | null;
  remedy: string | null;
}

export interface FemurDocument {
  side: "r" | "l" | null;
  side_from: "shape" | "name";
  fit_rms_mm: number | null;
  fits: Record<string, ShapeFit>;
  deviations_mm: Record<string, number>;
  deviations_deg: Record<string, number>;
  definitions: Record<string, string>;
  refused: Record<string, string>;
  warnings: Array<string>;
  hip_centre_mm: [number, number, number] | null;
  head_radius_mm: number | null;
  knee_centre_mm: [number, number, number] | null;
  knee_axis: [number, number, number] | null;
  knee_axis_cylinder: [number, number, number] | null;
  knee_axes_apart_deg: number | null;
  epicondyle_medial_mm: [number, number, number] | null;
  epicondyle_lateral_mm: [number, number, number] | null;
}

export interface FileEntry {
  name: string;
  size: number;
  sha256: string;
}

export interface FileList {
  items: Array<FileEntry>;
}

export interface FileRole {
  name: string;
  kind: "recording" | "forces" | "model" | "mesh" | "segmentation" | "image_markers" | "setup" | "subject" | "other";
  role: string | null;
  named: boolean;
  why: string;
  problem: ProblemEntry | null;
}

export interface FittedParameter {
  name: string;
  value: number;
  unit: "m" | "rad" | "1";
  sd: number | null;
  at_bound: boolean;
  identifiable: boolean;
}

export interface FriedmanEntry {
  chi_square: number;
  degrees_of_freedom: number;
  p: number;
  kendall_w: number;
  alpha: number;
  significant: boolean;
  pairs: Array<RankedPairEntry>;
}

export interface GaitAngleWord {
  name: string;
  title: string;
  negative: string;
  positive: string;
  usual_deg: Array<number> | null;
  usual_sd_deg: Array<number> | null;
}

export interface GaitEntry {
  trials: Array<string>;
  held_out: boolean;
  reason: string;
  angles: Record<string, CycleEntry>;
}

export interface GaitEventEntry {
  side: "r" | "l";
  kind: "strike" | "off";
  time_s: number;
}

export interface GaitScene {
  trials: Array<string>;
  held_out: boolean;
  reason: string;
  reference: string;
  angles: Record<string, CycleScene>;
}

export interface GapDocument {
  whitened: LevelDocument | null;
  markers_mm: LevelDocument | null;
  force_N: LevelDocument | null;
  moment_Nm: LevelDocument | null;
  places: Record<string, PlaceLevelDocument>;
}

export interface GateEntry {
  method: string;
  subjects: number;
  subjects_passed: number;
  trials: number;
  trials_passed: number;
}

export interface Gates {
  rms_below_mm: number;
  max_below_mm: number;
  meaning: "necessary, not sufficient";
  methods: Array<GateEntry>;
}

export interface GroundWrench {
  fx_N: number;
  fy_N: number;
  mz_Nm: number;
  fz_N: number | null;
  mx_Nm: number | null;
  my_Nm: number | null;
}

export interface HiddenDocument {
  kind: string;
  where: Array<string>;
  driver: Array<string>;
  trials: Array<string> | null;
  note: string;
  parameters: Record<string, number>;
}

export interface IdentificationDocument {
  headline: string;
  tone: "good" | "fair" | "poor" | "unknown" | "plain";
  components: [boolean, boolean, boolean, boolean, boolean, boolean];
  total_mass_kg: [number, number];
  trials: Record<string, WrenchFitDocument>;
  held_out_ratio: number | null;
  combinations: Array<CombinationChange>;
  parameters: Array<InertialChange>;
  warnings: Array<string>;
}

export interface ImagedPerson {
  subject: Person;
  bones?: Bones | null;
}

export interface InertialChange {
  segment: string;
  quantity: string;
  unit: "kg" | "m" | "kg m2";
  before: number;
  after: number;
  prior_sd: number;
  sd: number;
  moved: number;
  identifiable: boolean;
}

export interface InertialEntry {
  segment: string;
  quantity: string;
  before: number;
  after: number;
  sd: number;
  moved: number;
  identifiable: boolean;
}

export interface Interval {
  value: number;
  low: number | null;
  high: number | null;
}

export interface JobDocument {
  id: string;
  kind: string;
  state: State;
  progress: Progress;
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

export interface JobPage {
  items: Array<JobDocument>;
  next: string | null;
}

export type JobResult = CohortDocument | ComparisonDocument | ConsistentDocument | DiscoveryDocument | DynamicsDocument | JointAngleComparison | KinematicErrorComparison | LandmarksDocument | MemberResult | MotionDocument | ProofDocument | ScalingDocument | SegmentLengthComparison;

export interface JointAngleComparison {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  joint_angles: Record<string, Record<string, AngleEntry>>;
  gait: GaitEntry;
  warnings: Array<string>;
}

export interface JointAnglesRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  muscles?: boolean;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  methods?: Array<string> | null;
}

export interface JointCentre {
  frame: string;
  xyz: [number, number, number];
  sd_mm: [number, number, number] | null;
}

export interface JointLoad {
  unit: "N" | "N m";
  peak: number;
  rms: number;
}

export interface KinematicErrorComparison {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  kinematic_error_mm: Record<string, Record<string, TrialError>>;
  fitted_mean_mm: Record<string, number | null>;
  held_out_mean_mm: Record<string, number | null>;
  warnings: Array<string>;
}

export interface KinematicErrorDocument {
  mean: number | null;
  rms: number | null;
  max: number | null;
  per_marker: Record<string, number>;
}

export interface KinematicErrorRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  muscles?: boolean;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  methods?: Array<string> | null;
}

export interface KneeAxis {
  x: number;
  y: number;
}

export interface LabelEntry {
  label: string;
  seen: number;
  gaps: Array<[number, number]>;
  longest_gap_s: number;
  computed: boolean;
}

export interface LandmarksDocument {
  schema_version: number;
  code_version: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: null;
  wall_s: number;
  warnings: Array<string>;
  pelvis: PelvisDocument | null;
  femur_r: FemurDocument | null;
  tibia_r: TibiaDocument | null;
  talus_r: TalusDocument | null;
  femur_l: FemurDocument | null;
  tibia_l: TibiaDocument | null;
  talus_l: TalusDocument | null;
}

export interface LandmarksRequest {
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  bones?: Record<string, string> | null;
  units?: "mm" | "cm" | "m" | "detect";
}

export interface LengthEstimate {
  sd_mm: number;
  measured: number;
  others: number;
  expected: number;
}

export interface LevelDocument {
  before: number | null;
  after: number | null;
  floor: number | null;
  ceiling: number | null;
  low: number | null;
  high: number | null;
}

export interface LinearRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  method?: "MB" | "EB";
}

export interface Link {
  path: string;
  until: string;
}

export interface LinkRequest {
  path: string;
  lifetime_s?: number;
}

export interface LoopEntry {
  marker_rms_mm: number;
  ground_wrench_rmse: GroundWrench;
}

export interface MarkerErrors {
  classical: number;
  consistent: number;
  predicted: number;
}

export interface MarkerMap {
  labels: Record<string, string>;
}

export interface MarkerMapDocument {
  labels: Record<string, string>;
  updated_at: string | null;
}

export interface MarkerProof {
  marker: string;
  segment: string;
  anatomical: boolean;
  label: string | null;
  confidence: number;
  why: string;
  source: "document" | "laboratory" | "name" | "place" | null;
  recordings: Array<string>;
  others: Array<Candidate>;
}

export interface MarkerSetProof {
  name: string;
  title: string;
  share: number;
  lacks: Array<string>;
  additions: Array<string>;
}

export interface MarkerWord {
  name: string;
  segment: string;
  anatomical: boolean;
}

export interface MemberResult {
  status: "done" | "skipped";
  reason: string;
  wall_s: number;
}

export interface MethodResult {
  method: string;
  kinematic_error_mm: Record<string, TrialError>;
  fitted_mean_mm: number | null;
  held_out_mean_mm: number | null;
  held_out_ratio: number | null;
  segment_lengths_mm: Record<string, number>;
  length_estimates: Record<string, LengthEstimate>;
  segment_sources: Record<string, "bone" | "bone of the other leg" | "movement" | "markers" | "persons alike">;
  joint_centres_mm: Record<string, JointCentre>;
  knee_axis_deg: Record<string, KneeAxis>;
  marker_shift_mm: Record<string, number>;
  scale_factors: Record<string, [number, number, number]>;
  parameters: Array<FittedParameter>;
  cumulative_error_mm2: number | null;
  iterations: number;
  wall_s: WallTime;
  clinical: ClinicalDocument | null;
  warnings: Array<string>;
  files: Array<string>;
}

export interface MethodWord {
  name: string;
  meaning: string;
  starts_from: string | null;
  needs_images: boolean;
}

export interface ModelWord {
  name: string;
  segments: Array<string>;
  markers: Array<MarkerWord>;
  coordinates: Array<CoordinateWord>;
  feet: boolean;
}

export interface MotionDocument {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  model: string;
  locked: Array<string>;
  units: Record<string, "deg" | "m">;
  ranges: Record<string, [number, number]>;
  axes: string;
  trials: Record<string, TrackedTrialDocument>;
  warnings: Array<string>;
  files: Array<string>;
  wall_s: number;
}

export interface MotionEntry {
  poses: ArrayEntry;
  errors: ArrayEntry;
  coordinates: Array<CoordinateEntry>;
  angles: ArrayEntry;
  placed: ArrayEntry | null;
}

export interface MotionRequest {
  poses?: boolean;
  angles?: boolean;
  markers?: Record<string, string>;
  bone_pins?: boolean;
  up?: string | null;
  forward?: string | null;
  smooth_hz?: number | null;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  model?: string | null;
  recordings?: Array<string> | null;
  standing?: string | null;
}

export interface MuscleCurve {
  quantity: "moment arm" | "length" | "joint moment";
  muscle: string;
  coordinate: string;
  trial: string;
  unit: string;
  start_s: number;
  rate_hz: number;
  methods: Array<string>;
  values: ArrayEntry;
}

export interface MuscleDifference {
  method: string;
  against: string;
  quantity: "moment arm" | "length" | "joint moment";
  muscle: string;
  coordinate: string;
  trial: string;
  time_s: number;
  angle_deg: number | null;
  value: number;
  reference: number;
  difference: number;
  rms: number;
  unit: string;
}

export interface MuscleDocument {
  reference: string;
  trials: Array<string>;
  differences: Array<MuscleDifference>;
  summary: Array<string>;
  notes: Array<string>;
}

export interface MuscleScene {
  schema_version: number;
  curves: Array<MuscleCurve>;
}

export interface Need {
  name: string;
  there: boolean;
  required: boolean;
  text: string;
  give: "recordings" | "static" | "evaluation" | "bones" | "forces" | "model" | "height" | "mass";
}

export interface OptimisedRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  method?: "MB_lam" | "MB_am" | "EB_am" | "MAP";
}

export interface Origin {
  specification: Specification;
  provenance: Record<string, unknown> | null;
}

export interface Overview {
  file: string;
  shape: Array<number>;
  step: number;
}

export interface PelvisDocument {
  side: "r" | "l" | null;
  side_from: "shape" | "name";
  fit_rms_mm: number | null;
  fits: Record<string, ShapeFit>;
  deviations_mm: Record<string, number>;
  deviations_deg: Record<string, number>;
  definitions: Record<string, string>;
  refused: Record<string, string>;
  warnings: Array<string>;
  asis_r_mm: [number, number, number] | null;
  asis_l_mm: [number, number, number] | null;
  mid_asis_mm: [number, number, number] | null;
  psis_r_mm: [number, number, number] | null;
  psis_l_mm: [number, number, number] | null;
  acetabulum_r_mm: [number, number, number] | null;
  acetabulum_l_mm: [number, number, number] | null;
  pubic_tubercle_r_mm: [number, number, number] | null;
  pubic_tubercle_l_mm: [number, number, number] | null;
  asis_axis: [number, number, number] | null;
  pose_odds_log10: number | null;
}

export interface Person {
  id: string;
  sex?: "F" | "M" | null;
  height_m?: number | null;
  mass_kg?: number | null;
}

export interface PlaceLevelDocument {
  before: number | null;
  after: number | null;
  floor: number | null;
  ceiling: number | null;
  low: number | null;
  high: number | null;
  unit: "1" | "mm" | "N" | "N m";
}

export interface PlacedEffect {
  kind: string;
  where: Array<string>;
  driver: Array<string>;
  trials: Array<string> | null;
  note: string;
}

export interface PlacedEntry {
  name: string;
  segment: string;
  xyz_m: [number, number, number];
}

export interface PlateEntry {
  name: string;
  corners_m: Array<[number, number, number]> | null;
  peak_N: number | null;
  kind: number | null;
  centre_m: Array<number> | null;
  loaded_by: Array<string>;
  offset_N: number | null;
}

export interface Problem {
  type: string;
  title: string;
  status: number;
  detail: string;
  problem: string;
  file: string | null;
  field: string | null;
  remedy: string | null;
}

export interface ProblemEntry {
  severity: "error" | "warning" | "note";
  file: string | null;
  field: string | null;
  problem: string;
  remedy: string | null;
  corrections: Array<CorrectionEntry>;
}

export interface ProcessingSettings {
  smoothing?: "automatic" | "butterworth" | "none";
  cutoff_hz?: number;
  longest_spline_s?: number;
  solidify?: boolean;
}

export interface Progress {
  what: string;
  share: number;
}

export interface ProofDocument {
  schema_version: number;
  subject: string;
  model: string;
  model_why: string | null;
  axes: AxesEntry | null;
  files: Array<FileRole>;
  recordings: Array<RecordingProof>;
  marker_set: MarkerSetProof | null;
  consequences: Array<string>;
  sizes: SizesProof | null;
  markers: Array<MarkerProof>;
  unused_labels: Array<string>;
  extra_markers: Array<ExtraMarker>;
  readiness: Array<Readiness>;
  headline: string;
  proposal: Record<string, unknown> | null;
  problems: Array<ProblemEntry>;
}

export interface ProofRequest {
  subject: string;
  labels?: Record<string, string>;
  settings?: Settings;
}

export interface QuantityDocument {
  value: number | [number, number, number];
  sd: number | null;
  usual: [number, number] | null;
  at_bound: boolean;
  determined: boolean;
}

export interface QuantityEntry {
  quantity: string;
  compared: Compared;
  mean: Record<string, number>;
  sd: Record<string, number>;
  values: Record<string, Record<string, number>>;
  friedman: FriedmanEntry | null;
  note: string;
}

export interface RankedPairEntry {
  methods: [string, string];
  difference_mean: number;
  difference_sd: number;
  p: number;
  significant: boolean;
}

export interface Readiness {
  analysis: string;
  title: string;
  ready: boolean;
  needs: Array<Need>;
}

export interface RecordingProof {
  name: string;
  file: string;
  format: string;
  unit: string;
  rate_hz: number;
  frames: number;
  start_s: number;
  axes: AxesEntry;
  walked_m: number;
  direction: [number, number, number] | null;
  labels: Array<LabelEntry>;
  markers: ArrayEntry;
  plates: Array<PlateEntry>;
  events: Array<EventProof>;
  forces_from: string | null;
  force: ArrayEntry | null;
  centre_of_pressure: ArrayEntry | null;
  repairs: Array<RepairEntry>;
  problems: Array<ProblemEntry>;
}

export interface RepairEntry {
  what: string;
  where: string;
  detail: string;
  frames: number;
}

export interface RepairNote {
  what: string;
  where: string;
  detail: string;
  frames: number;
}

export interface ResidualGate {
  name: string;
  source: string;
  value: number;
  limit: number;
  unit: "N" | "N m";
  passed: boolean;
}

export interface ResidualScene {
  schema_version: number;
  trials: Record<string, ResidualTrial>;
}

export interface ResidualTrial {
  start_s: number;
  rate_hz: number;
  residual: ArrayEntry;
}

export interface ScalingDocument {
  method: string;
  kinematic_error_mm: Record<string, TrialError>;
  fitted_mean_mm: number | null;
  held_out_mean_mm: number | null;
  held_out_ratio: number | null;
  segment_lengths_mm: Record<string, number>;
  length_estimates: Record<string, LengthEstimate>;
  segment_sources: Record<string, "bone" | "bone of the other leg" | "movement" | "markers" | "persons alike">;
  joint_centres_mm: Record<string, JointCentre>;
  knee_axis_deg: Record<string, KneeAxis>;
  marker_shift_mm: Record<string, number>;
  scale_factors: Record<string, [number, number, number]>;
  parameters: Array<FittedParameter>;
  cumulative_error_mm2: number | null;
  iterations: number;
  wall_s: WallTime;
  clinical: ClinicalDocument | null;
  warnings: Array<string>;
  files: Array<string>;
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
}

export interface ScalingRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  muscles?: boolean;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  methods?: Array<string> | null;
}

export interface SceneDocument {
  schema_version: number;
  subject: string;
  bodies: Array<BodyEntry>;
  trials: Array<SceneTrial>;
  gait: GaitScene | null;
}

export interface SceneTrial {
  name: string;
  role: "calibration" | "evaluation";
  frames: number;
  rate_hz: number;
  start_s: number;
  labels: Array<string>;
  measured: ArrayEntry;
  motions: Record<string, MotionEntry>;
  plates: Array<PlateEntry>;
  force: ArrayEntry | null;
  centre_of_pressure: ArrayEntry | null;
}

export interface SegmentEntry {
  name: string;
  parent: string;
  shape: "image" | "simple" | "none";
}

export interface SegmentLengthComparison {
  schema_version: number;
  code_version: string;
  subject: string;
  settings: Record<string, unknown>;
  input_hashes: Record<string, string>;
  seed: number;
  markers_used: Record<string, Array<string>>;
  repairs: Record<string, Array<RepairNote>>;
  sizes: Record<string, number>;
  segment_lengths_mm: Record<string, Record<string, number>>;
  joint_centres_mm: Record<string, Record<string, JointCentre>>;
  reference: string;
  difference_mm: Record<string, Record<string, number>>;
  warnings: Array<string>;
}

export interface SegmentLengthsRequest {
  export?: Array<"mjcf" | "biomod">;
  muscle_points?: "scaled" | "surface";
  muscle_parameters?: "ratio" | "range";
  muscles?: boolean;
  tables?: Array<"csv" | "parquet" | "bids">;
  subject: string;
  settings?: Settings;
  methods?: Array<string> | null;
}

export interface Settings {
  calibration?: CalibrationSettings;
  processing?: ProcessingSettings;
  up?: string | null;
  forward?: string | null;
  seed?: number;
}

export interface ShapeFit {
  shape: "sphere" | "cylinder";
  centre_mm: [number, number, number];
  radius_mm: number;
  axis: [number, number, number] | null;
  rms_mm: number;
  covered: number;
}

export interface SizesProof {
  height_m: number | null;
  mass_kg: number | null;
  sex: "F" | "M" | null;
  sizes_mm: Record<string, number>;
  source: Array<string>;
}

export interface Specification {
  kind: string;
  request: Record<string, unknown>;
  documents: Record<string, Record<string, unknown>>;
  inputs: Record<string, string>;
  code_version: string;
  owner: string;
}

export type State = "waiting" | "queued" | "running" | "cancelling" | "done" | "failed" | "cancelled";

export interface StatisticsDocument {
  segment_lengths_mm: Array<QuantityEntry>;
  kinematic_error_mm: Array<QuantityEntry>;
  knee_axis_deg: Array<QuantityEntry>;
  marker_shift_mm: Array<QuantityEntry>;
  from_truth_mm: Array<QuantityEntry>;
  from_truth_deg: Array<QuantityEntry>;
  joint_angles: Array<CurveEntry>;
  agreement: Array<AgreementEntry>;
  opensim_limits: Gates;
  notes: Array<string>;
}

export interface SubjectDetail {
  id: string;
  created_at: string;
  updated_at: string;
  revision: number;
  document: Record<string, unknown>;
  files: Array<FileEntry>;
}

export interface SubjectDocument {
  subject: Person;
  model: string;
  marker_set?: string | null;
  scale_setup?: string | null;
  markers?: Record<string, string>;
  extra_markers?: Record<string, string>;
  trials: Trials;
  forces?: Record<string, string>;
  corrections?: Record<string, Array<Correction>>;
  mirrored?: Record<string, "x" | "y" | "z">;
  events?: Record<string, Array<GaitEventEntry>>;
  bones?: Bones | null;
  bone_bodies?: Record<string, string>;
  image_markers?: string | null;
  sizes?: Record<string, number>;
}

export interface SubjectEntry {
  id: string;
  file: string;
  groups: Record<string, string>;
  status: "done" | "skipped" | "failed";
  reason: string;
  kept: boolean;
  folder: string | null;
  methods: Array<string>;
  left_out: Record<string, string>;
  strides: Record<string, number>;
  no_strides: Record<string, string>;
  wall_s: number;
}

export interface SubjectNote {
  text: string;
  signed_by?: string | null;
  results?: Array<string>;
}

export interface SubjectNoteDocument {
  text: string;
  signed_by?: string | null;
  results?: Array<string>;
  updated_at: string | null;
}

export interface SubjectPage {
  items: Array<SubjectSummary>;
  next: string | null;
}

export interface SubjectSummary {
  id: string;
  created_at: string;
  updated_at: string;
  revision: number;
}

export interface TalusDocument {
  side: "r" | "l" | null;
  side_from: "shape" | "name";
  fit_rms_mm: number | null;
  fits: Record<string, ShapeFit>;
  deviations_mm: Record<string, number>;
  deviations_deg: Record<string, number>;
  definitions: Record<string, string>;
  refused: Record<string, string>;
  warnings: Array<string>;
  ankle_centre_mm: [number, number, number] | null;
  ankle_axis: [number, number, number] | null;
  subtalar_centre_mm: [number, number, number] | null;
  subtalar_axis: [number, number, number] | null;
}

export interface TestEntry {
  p: number | null;
  can_decide: boolean;
  differ_percent: Array<[number, number]>;
}

export interface TibiaDocument {
  side: "r" | "l" | null;
  side_from: "shape" | "name";
  fit_rms_mm: number | null;
  fits: Record<string, ShapeFit>;
  deviations_mm: Record<string, number>;
  deviations_deg: Record<string, number>;
  definitions: Record<string, string>;
  refused: Record<string, string>;
  warnings: Array<string>;
  ankle_centre_mm: [number, number, number] | null;
  ankle_centre_from: "talus" | "malleoli" | null;
  knee_centre_mm: [number, number, number] | null;
  ankle_centre_malleoli_mm: [number, number, number] | null;
  ankle_axis: [number, number, number] | null;
  plateau_axis: [number, number, number] | null;
  malleolus_medial_mm: [number, number, number] | null;
  malleolus_lateral_mm: [number, number, number] | null;
  malleolus_medial_prominence_mm: [number, number, number] | null;
  malleolus_lateral_prominence_mm: [number, number, number] | null;
  fibula_head_mm: [number, number, number] | null;
  plateau_medial_mm: [number, number, number] | null;
  plateau_lateral_mm: [number, number, number] | null;
}

export interface TrackedTrialDocument {
  kinematic_error_mm: KinematicErrorDocument;
  not_determined: Array<string>;
  frames_not_determined: Record<string, number>;
  frames_at_range_end: Record<string, number>;
  marker_noise_mm: Record<string, number>;
  rotation_error_deg: Record<string, number>;
  frames: number;
  summary: Record<string, CoordinateSummary>;
}

export interface TrialDynamicsDocument {
  role: "calibration" | "evaluation";
  forces_from: string;
  frames: number;
  left_out: number;
  residual_rms: Wrench;
  dr: [number, number, number, number, number, number];
  gates: Array<ResidualGate>;
  joint_loads: Record<string, JointLoad>;
  reconstruction_error_mm: number;
  uncertainty: UncertaintyDocument;
  slopes_per_cm: [number, number, number, number, number, number];
  r2: [number, number, number, number, number, number];
  calibration_supported: [boolean, boolean, boolean, boolean, boolean, boolean];
  unmeasured: Array<string>;
  warnings: Array<string>;
}

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

export interface Trials {
  static?: string | null;
  calibration?: Array<string>;
  evaluation?: Array<string>;
}

export interface TriedDocument {
  kind: string;
  where: Array<string>;
  driver: Array<string>;
  trials: Array<string> | null;
  note: string;
  gain: number | null;
  log_odds: number | null;
  smallest_nameable: Record<string, number>;
}

export interface TrustNote {
  topic: string;
  level: "good" | "fair" | "poor" | "unknown";
  text: string;
}

export interface TruthDocument {
  segment_lengths_mm: Record<string, number>;
  errors: Record<string, Record<string, number>>;
}

export interface UncertaintyDocument {
  kinematic: [number, number, number, number, number, number];
  plate: [number, number, number, number, number, number];
  total: [number, number, number, number, number, number];
}

export interface UnexplainedDocument {
  where: Array<string>;
  observable: "marker" | "force" | "moment";
  unit: "1" | "mm" | "N" | "N m";
  law: string;
  rms: number;
  floor: number | null;
}

export interface VerdictDocument {
  method: string;
  strength: "decided" | "leaning" | "undecided";
  headline: string;
  tone: "good" | "fair" | "poor" | "unknown" | "plain";
  why: Array<string>;
  trust: Array<TrustNote>;
}

export interface Vocabulary {
  models: Array<ModelWord>;
  methods: Array<MethodWord>;
  bones: Array<string>;
  gait_angles: Array<GaitAngleWord>;
  hidden_in_example: Array<string>;
}

export interface WallTime {
  calibration: number;
  inverse_kinematics: number;
}

export interface WeightDocument {
  declared_kg: number;
  plates_kg: number;
  sd_kg: number;
  differs: boolean;
  by_trial_kg: Record<string, number>;
}

export interface Wrench {
  fx_N: number;
  fy_N: number;
  fz_N: number;
  mx_Nm: number;
  my_Nm: number;
  mz_Nm: number;
}

export interface WrenchErrors {
  classical: GroundWrench;
  consistent: GroundWrench;
  predicted: GroundWrench;
}

export interface WrenchFitDocument {
  held_out: boolean;
  frames: number;
  before: Wrench;
  after: Wrench;
}

export interface WrenchScene {
  schema_version: number;
  trials: Record<string, WrenchTrial>;
}

export interface WrenchTrial {
  start_s: number;
  rate_hz: number;
  components: Array<boolean>;
  wrenches: Record<string, ArrayEntry>;
}
