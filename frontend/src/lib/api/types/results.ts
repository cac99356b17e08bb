/** Results of single runs, and what a vehicle's camera is given. */

import type { Transform } from "./fleets.ts";

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

/** What a camera was given: by whom, when, why, and what spoke against it. */
export interface Publication {
  id: string;
  camera: string;
  result_id: string;
  calibration_id: string;
  model: string;
  published_at: string;
  /** Null where the person is no longer known. */
  published_by: string | null;
  reason: string | null;
  override: { reason: string; objections: string[] } | null;
  is_current: boolean;
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
