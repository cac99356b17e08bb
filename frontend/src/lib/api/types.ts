/** The documents of the service's API, as the pages use them. Stamps ending in _ns are integer nanoseconds. */

import type { ProblemDocument } from "./http.ts";

export type Role = "viewer" | "annotator" | "reviewer" | "engineer" | "admin";
export const ROLES: readonly Role[] = ["viewer", "annotator", "reviewer", "engineer", "admin"];

export interface Me {
  id: string;
  name: string;
  is_owner: boolean;
  fleets: { id: string; name: string; role: Role }[];
}

export interface Member {
  person_id: string;
  name: string;
  role: Role;
}

export interface Invitation {
  person_id: string;
  name: string;
  role: Role;
  link: string;
  expires_at: string;
}

export interface Fleet {
  id: string;
  name: string;
}

export interface Vehicle {
  id: string;
  fleet_id: string;
  name: string;
}

export type Rotation =
  | { euler_order: "zyx" | "xyz_eq2"; angles_deg: number[] }
  | { matrix: number[][] }
  | { quaternion_xyzw: number[] };

export interface Transform {
  to_frame: string;
  from_frame: string;
  rotation: Rotation;
  translation_m: number[];
}

export interface RigCamera {
  name: string;
  frame: string;
  topic: string | null;
  image_size: [number, number];
  nominal: Transform;
  bounds: Record<string, [number, number]>;
}

/** T_cameraA_cameraB as known otherwise. */
export interface CameraTransform {
  transform: Transform;
  std_deg: number;
  std_mm: number;
}

export interface RigRequest {
  name: string;
  lidar: { frame: string; topic: string | null };
  T_vehicle_lidar: Transform | null;
  cameras: RigCamera[];
  camera_transforms?: CameraTransform[];
}

export interface Rig extends RigRequest {
  id: string;
  fleet_id: string;
  vehicle_id: string;
}

export type JobState = "queued" | "running" | "done" | "failed" | "cancelled";

export interface JobProgress {
  fraction: number | null;
  message: string | null;
}

export interface Job {
  id: number;
  kind: string;
  state: JobState;
  attempt: number;
  progress: JobProgress | null;
  /** About how long a running job still takes; null where that is not known. */
  seconds_left: number | null;
  problem: ProblemDocument | null;
}

export interface Sensor {
  id: string;
  kind: string;
  name: string;
  topic: string;
  frame_id: string;
  count: number;
  first_ns: number;
  last_ns: number;
  facts: Record<string, unknown>;
}

/** What the owner knows of a recording's file; `topics` says which is which. */
export interface Reading {
  topics?: { lidar?: string; cameras?: Record<string, string> };
  [name: string]: unknown;
}

/** A topic of a recording that could not be read without knowing which is which. */
export interface Candidate {
  name: string;
  kind: "lidar" | "camera";
  count?: number | null;
  width?: number;
  height?: number;
}

export interface Recording {
  id: string;
  fleet_id: string;
  vehicle_id: string;
  rig_id: string;
  name: string;
  file_name: string;
  state: "uploading" | "queued" | "ingesting" | "ready" | "failed";
  size: number;
  marks_per_vertex: number;
  reading: Reading;
  facts: Record<string, unknown> | null;
  warnings: unknown[];
  problem: ProblemDocument | null;
  job: Job | null;
  sensors?: Sensor[];
  created_at: string;
  version: number;
}

export interface UploadedPart {
  number: number;
  size: number;
  sha256: string;
}

export interface Frame {
  index: number;
  stamp_ns: number;
  media_type: string;
  width: number;
  height: number;
}

/** A question about a recording that a worker answers. */
export interface Study<Result> {
  id: string;
  state: JobState;
  result: Result | null;
  problem: ProblemDocument | null;
  job: Job | null;
}

export type RegionPreview = Study<Record<string, unknown>>;

export interface SuggestionFacts {
  sweeps_read: number;
  sweeps_moving: number;
  area_m2: number;
  points_per_sweep: number;
  notes: string[];
}

export type RegionSuggestion = Study<{ region: unknown; facts: SuggestionFacts }>;

export interface ClockOffset
  extends Study<{ offset_ns: number; sigma_ns: number; rms_px: number; pairs: number; message?: string }> {
  detection_id: string;
  camera: string;
  marks: number;
  hint: string | null;
}

export interface Pairing {
  mode: "nearest" | "interpolate";
  offset_ns: number;
  max_gap_ns: number;
}

export interface DetectionCounts {
  sweeps?: number;
  accepted?: number;
  rejected?: Record<string, number>;
  /** Vertices by class, where the detector grades them. */
  quality?: Record<string, number>;
  /** Vertices by what one should look at. */
  flags?: Record<string, number>;
  paired?: number | Record<string, number>;
}

export interface Detection {
  id: string;
  recording_id: string;
  region: unknown;
  detector: string;
  options: Record<string, unknown>;
  pairing: Pairing;
  state: JobState;
  counts: DetectionCounts;
  problem: ProblemDocument | null;
  job: Job | null;
  created_at: string;
}

export interface Vertex {
  id: string;
  sweep_index: number;
  time_ns: number;
  x: number;
  y: number;
  z: number;
  ring?: number;
  points?: number;
  quality?: "fine" | "usable" | null;
  flags?: { name: string; sentence: string }[];
  frames?: Record<string, { index: number; gap_ns: number }>;
}

export type VerdictName = "confirmed" | "rejected" | "unsure";

export interface MarkPoint {
  u: number;
  v: number;
  version?: number;
}

export interface MarkingTask {
  task_id: string;
  leased_until: string;
  vertex: Vertex;
  camera: string;
  frame: { index: number; stamp_ns: number; width: number; height: number; url: string };
  gap_ns: number;
  predicted: MarkPoint | null;
  own: { mark: MarkPoint | null; verdict: VerdictName | null } | null;
}

export interface MarkingProgress {
  vertices: number;
  marks_wanted: number;
  answered: number;
  mine: number;
  complete: number;
  confirmed: number;
  rejected: number;
  unsure: number;
  marks: number;
  people: { name: string; answers: number }[];
}

export interface TaskAnswer {
  mark: MarkPoint | null;
  verdict: VerdictName | null;
  progress: MarkingProgress;
  others: MarkPoint[];
}

export interface CorrespondenceSet {
  id: string;
  rig_id: string;
  vehicle_id: string;
  recording_id: string | null;
  camera: string;
  source: "annotations" | "import";
  count: number;
  content_hash: string;
  notes: string[];
  flagged?: number;
  created_at?: string;
}

export const MODELS = ["pinhole", "brown_conrady", "kannala_brandt"] as const;
export type ModelName = (typeof MODELS)[number];

export interface CalibrationRequest {
  correspondence_set_ids: string[];
  models: ModelName[];
  preset: "default" | "paper" | "toolbox";
  search: "rotation_vector" | "euler";
  loss: "mean" | "saturating";
  outliers: "keep" | "exclude";
  bounds_preset: "image-size" | "paper-table-1";
  intrinsics_from: "bounds" | "recording";
  folds: number;
  farm: "auto" | "slots" | "runs";
  seed: number | null;
  publish: "recommended" | "none";
}

export interface CalibrationRun {
  camera: string;
  model: string;
  fold: number;
  state: string;
  iteration: number;
  best_loss: number | null;
  failure: ProblemDocument | null;
}

export interface Errors {
  mean_px: number | null;
  rms_px: number | null;
}

export interface ModelSummary {
  result_id: string | null;
  ga?: Errors | null;
  polished?: Errors | null;
  /** Least squares from the centre of the bounds. */
  baseline?: Errors | null;
  /** A direct linear transformation with RANSAC, then least squares; null where no linear camera fits. */
  linear_baseline?: Errors | null;
  /** How much higher the held-out error is than that of the model with the lowest one. */
  behind?: { px: number; standard_error_px: number; within_noise: boolean };
  heldout_mean_px?: number | null;
  heldout_rms_px?: number | null;
  seconds?: number | null;
  workers?: string[];
  iterations?: number | null;
  alarms?: unknown[];
}

export interface CameraSummary {
  recommended: string | null;
  why: string;
  models: Record<string, ModelSummary>;
  /** Only where a publication was asked for: why the recommended result did not publish itself. */
  not_published?: string[];
}

/** Two cameras of a rig, each calibrated on its own, held against each other. */
export interface CameraPair {
  cameras: [string, string];
  models: [string, string];
  name: string;
  transform: Transform | null;
  std: Record<string, number> | null;
  interval95_half_width: Record<string, number> | null;
  stated: {
    source: "nominal" | "rig";
    rotation_deg: number;
    translation_mm: number;
    sigmas: number;
    std_deg: number;
    std_mm: number;
  }[];
  shared: {
    vertices: number;
    odd: { indices: [number, number]; stamp_ns: number | null; distance_px: number; sigmas: number }[];
  } | null;
  sentences: string[];
  alarms: string[];
}

export interface RigConsistency {
  pairs: CameraPair[];
  alarms: string[];
  left_out?: string[];
  problem?: ProblemDocument | null;
}

export interface CalibrationSummary {
  cameras: Record<string, CameraSummary>;
  rig?: RigConsistency;
}

export interface Calibration {
  id: string;
  fleet_id?: string;
  vehicle_id: string;
  rig_id: string;
  state: string;
  request: Partial<CalibrationRequest>;
  notes: string[];
  problem: ProblemDocument | null;
  progress: JobProgress | null;
  runs: CalibrationRun[];
  summary: CalibrationSummary | null;
  created_at: string;
  finished_at: string | null;
}

/** A pair that the others speak against, and where it comes from. */
export interface Outlier {
  index: number;
  residual_px: number;
  score: number;
  reason: string;
  excluded: boolean;
  pair?: { stamp_ns?: number; frame_index?: number; sweep_index?: number; group?: number | string; u?: number; v?: number };
}

/** A run's solution; `parameters` and `std` are in degrees, metres and pixels. */
export interface Result {
  id: string;
  calibration_id: string;
  camera: string;
  model: string;
  fold: number;
  status?: string;
  message?: string;
  pairs?: number;
  free_parameters?: number;
  parameters?: Record<string, number>;
  std?: Record<string, number | null>;
  interval95_half_width?: Record<string, number | null>;
  covariance?: { names: string[]; units: string[] };
  correlation?: number[][];
  outliers?: Outlier[];
  recording_id?: string | null;
  intrinsics?: Record<string, unknown>;
  /** T_camera_lidar. */
  transform?: Transform;
  sigma_px?: number;
  residuals_px?: number[];
  worst_correlation?: { pair: [string, string]; value: number } | null;
  at_bounds?: string[];
  alarms?: unknown[];
}

export interface CurrentCalibration {
  vehicle_id: string;
  camera: string;
  published_at: string;
  result_id: string;
  calibration_id: string;
  model: string;
  intrinsics: Record<string, number>;
  T_camera_lidar: Transform;
  T_vehicle_camera?: Transform | null;
  quality?: Record<string, unknown> | null;
}
