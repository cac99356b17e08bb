/** Marking: tasks, answers and their progress. */

import type { Vertex } from "./detections.ts";

export type VerdictName = "confirmed" | "rejected" | "unsure";

export interface MarkPoint {
  u: number;
  v: number;
}

/** What this person said of a vertex: `version` 0 for nothing yet; an answer taken back has a mark and no verdict. */
export interface OwnAnswer {
  version: number;
  mark: MarkPoint | null;
  verdict: VerdictName | null;
}

export interface MarkingTask {
  task_id: string;
  person_id: string;
  leased_until: string;
  vertex: Vertex;
  camera: string;
  frame: { index: number; stamp_ns: number; width: number; height: number; url: string };
  gap_ns: number;
  predicted: MarkPoint | null;
  own: OwnAnswer;
}

export interface MarkingProgress {
  vertices: number;
  marks_wanted: number;
  answered: number;
  mine: number;
  complete: number;
}

/** What people said, in numbers. */
export interface MarkingTally {
  answers: number;
  confirmed: number;
  rejected: number;
  unsure: number;
  marks: number;
  reviewed: number;
  people: { name: string; answers: number }[];
}

/** An answer as it is sent: `id` is the browser's own, `version` that of the answer that it replaces. */
export interface NewAnswer {
  id: string;
  version: number;
  verdict: VerdictName;
  mark: MarkPoint | null;
}
