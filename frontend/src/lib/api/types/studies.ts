/** Questions about a recording: regions tried and suggested, the offset of the clocks. */

import type { Study } from "./jobs.ts";

export type RegionPreview = Study<Record<string, unknown>>;

export interface SuggestionFacts {
  sweeps_read: number;
  sweeps_moving: number;
  area_m2: number;
  points_per_sweep: number;
  notes: string[];
}

export type RegionSuggestion = Study<{ region: unknown; facts: SuggestionFacts }>;

export interface ClockOffset extends Study<{
  offset_ns: number;
  sigma_ns: number;
  rms_px: number;
  pairs: number;
  message?: string;
}> {
  detection_id: string;
  camera: string;
  marks: number;
  hint: string | null;
}
