/** Long work: jobs, and questions that a worker answers. */

import type { ProblemDocument } from "../http.ts";

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

/** A question about a recording that a worker answers. */
export interface Study<Result> {
  id: string;
  state: JobState;
  result: Result | null;
  problem: ProblemDocument | null;
  job: Job | null;
}
