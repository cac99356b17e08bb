/** Fleet requests: one calibration asked for of many vehicles, and what became of each. */

import type { ProblemDocument } from "../http.ts";
import type { CalibrationTemplate } from "./calibrations.ts";
import type { JobProgress } from "./jobs.ts";

/** Which vehicles of the fleet: those that everything given here is true of; with nothing given, all. */
export interface VehicleFilter {
  vehicle_ids?: string[];
  /** Patterns, in which * stands for any letters and ? for one. */
  name?: string;
  rig?: string;
  /** A moment with its zone. */
  not_calibrated_since?: string;
  new_pairs?: boolean;
}

export interface FleetRequestBody {
  vehicles: VehicleFilter;
  calibration: CalibrationTemplate;
}

export const VEHICLE_STATES = ["queued", "running", "done", "failed", "cancelled", "skipped"] as const;
export type VehicleState = (typeof VEHICLE_STATES)[number];

/** How many vehicles the filter matched, and how many of them are in which state. */
export type Counts = Record<VehicleState | "matched", number>;

export interface FleetRequest {
  id: string;
  fleet_id: string;
  state: "running" | "done" | "done_with_failures" | "cancelled";
  /** As the service filled it in: what was not given is null. */
  asked: {
    vehicles: { [Name in keyof VehicleFilter]?: VehicleFilter[Name] | null };
    calibration: Partial<CalibrationTemplate>;
  };
  asked_by: string | null;
  counts: Counts;
  /** For how many vehicles a result was published; null while it runs, and where nobody asked for it. */
  published: number | null;
  progress: JobProgress;
  seconds_left: number | null;
  cancel_requested: boolean;
  created_at: string;
  finished_at: string | null;
}

/** What a vehicle's calibration recommends for a camera. `published` is null where nobody asked for it. */
export interface CameraOutcome {
  model: string | null;
  mean_px: number | null;
  heldout_mean_px: number | null;
  /** Of the recommended result; where it is not `ok` the errors say little. */
  status: string | null;
  warnings: number;
  published: boolean | null;
  not_published: string[];
  /** What speaks against publishing it, as found when the calibration ended. */
  objections: string[];
}

export interface RequestVehicle {
  vehicle_id: string;
  vehicle: string;
  state: VehicleState;
  calibration_id: string | null;
  problem: ProblemDocument | null;
  cameras: Record<string, CameraOutcome>;
  finished_at: string | null;
}

/** What a fleet request would come to; `skipped_vehicles` are the first hundred. */
export interface DryRun {
  matched: number;
  calibrations: number;
  runs: number;
  processor_seconds: number;
  skipped: number;
  skipped_vehicles: { vehicle_id: string; vehicle: string; problem: ProblemDocument }[];
}
