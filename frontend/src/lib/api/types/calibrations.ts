/** Correspondence sets, calibrations and their summaries. */

import type { ProblemDocument } from "../http.ts";
import type { Transform } from "./fleets.ts";
import type { JobProgress } from "./jobs.ts";

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

/** What is fitted and how, whatever the pairs. Null means what the preset means. */
export interface CalibrationTemplate {
  models: ModelName[];
  preset: "default" | "paper" | "toolbox";
  search: "rotation_vector" | "euler" | null;
  loss: "mean" | "saturating";
  outliers: "keep" | "exclude";
  bounds_preset: "image-size" | "paper-table-1" | null;
  intrinsics_from: "bounds" | "recording";
  folds: number;
  farm: "auto" | "slots" | "runs";
  seed: number | null;
  publish: "recommended" | "none";
}

export interface CalibrationRequest extends CalibrationTemplate {
  correspondence_set_ids: string[];
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
  status?: string;
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
  /** What speaks against publishing it, as found when the calibration ended. */
  objections?: string[];
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
