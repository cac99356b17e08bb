/** Detections and their vertices. Stamps ending in _ns are integer nanoseconds. */

import type { ProblemDocument } from "../http.ts";
import type { Job, JobState } from "./jobs.ts";

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
