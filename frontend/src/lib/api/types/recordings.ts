/** Recordings, their sensors and frames. Stamps ending in _ns are integer nanoseconds. */

import type { ProblemDocument } from "../http.ts";
import type { Job } from "./jobs.ts";

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
