/** Marking: tasks, verdicts and marks. */

import type { Vertex } from "./detections.ts";

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
