/** What the service's description leaves open as "an object", typed by hand. What it describes is no longer here. */

import type { ProblemDocument } from "./http.ts";
import type { components } from "./schema.ts";
import type { Region } from "../region.ts";
import type { CalibrationRequest, CalibrationTemplate, JobProgress, Transform, VehicleFilter } from "./types.ts";

type Schemas = components["schemas"];

type With<Known, Open> = Omit<Known, keyof Open> & Open;

export type Job = With<Schemas["JobView"], { progress: JobProgress | null; problem: ProblemDocument | null }>;

interface Worked {
  problem: ProblemDocument | null;
  job: Job | null;
}

export interface RigCamera {
  name: string;
  frame: string;
  topic: string | null;
  image_size: [number, number];
  nominal: Transform;
  bounds: Record<string, [number, number]>;
}

export type Rig = With<Schemas["RigOut"], { lidar: { frame: string; topic: string | null }; cameras: RigCamera[] }>;

export type RecordingSummary = With<Schemas["RecordingSummary"], Worked>;
export type Recording = With<Schemas["RecordingView"], Worked & { reading: Schemas["Reading"] }>;

/** A topic of a recording that could not be read without knowing which is which. */
export interface Candidate {
  name: string;
  kind: "lidar" | "camera";
  count?: number | null;
  width?: number;
  height?: number;
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

export type DetectionRequest = With<Schemas["DetectionRequest"], { region: Region }>;

export type Detection = With<
  Schemas["DetectionView"],
  Worked & { region: Region; pairing: Required<Schemas["Pairing"]>; counts: DetectionCounts }
>;

export interface SuggestionFacts {
  sweeps_read: number;
  sweeps_moving: number;
  area_m2: number;
  points_per_sweep: number;
  notes: string[];
}

export interface RegionCounts {
  frames: number;
  frames_kept: number;
  points: number;
  points_kept: number;
  points_per_frame_median: number;
  per_ring: { ring: number; points: number; points_kept: number }[];
}

export type RegionPreview = With<Schemas["PreviewView"], Worked & { result: RegionCounts | null }>;
export type RegionSuggestion = With<
  Schemas["SuggestionView"],
  Worked & { result: { region: Region; facts: SuggestionFacts } | null }
>;
export type ClockOffset = With<
  Schemas["OffsetView"],
  Worked & { result: { offset_ns: number; sigma_ns: number; rms_px: number; pairs: number; message?: string } | null }
>;

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

export type Calibration = With<
  Schemas["CalibrationView"],
  {
    request: Partial<CalibrationRequest>;
    problem: ProblemDocument | null;
    runs: With<Schemas["RunView"], { failure: ProblemDocument | null }>[];
    summary: CalibrationSummary | null;
  }
>;

/** A pair that the others speak against, and where it comes from. */
export interface Outlier {
  index: number;
  residual_px: number;
  score: number;
  reason: string;
  excluded: boolean;
  pair?: {
    stamp_ns?: number;
    frame_index?: number;
    sweep_index?: number;
    group?: number | string;
    u?: number;
    v?: number;
  };
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
  /** The pairs of the fit: fewer than `pairs` where outliers were left out. */
  kept?: { pairs: number };
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
  /** What speaks against publishing it now; null of a fit that is not to all pairs. */
  objections: string[] | null;
}

export interface CurrentCalibration {
  vehicle_id: string;
  camera: string;
  publication_id: string;
  published_at: string;
  published_by: string | null;
  reason: string | null;
  override: { reason: string; objections: string[] } | null;
  result_id: string;
  calibration_id: string;
  model: string;
  intrinsics: Record<string, number>;
  T_camera_lidar: Transform;
  T_vehicle_camera?: Transform | null;
  quality?: Record<string, unknown> | null;
}

export type RequestVehicle = With<Schemas["RequestVehicleView"], { problem: ProblemDocument | null }>;

export type FleetRequest = With<
  Schemas["FleetRequestView"],
  { asked: { vehicles: VehicleFilter; calibration: CalibrationTemplate } }
>;

export type DryRun = With<
  Schemas["DryRunView"],
  { skipped_vehicles: With<Schemas["SkippedView"], { problem: ProblemDocument }>[] }
>;
