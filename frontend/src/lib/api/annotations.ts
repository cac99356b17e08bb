/** Marking: tasks one after the other, answers, and taking one back. */

import { bodyOf, client } from "./http.ts";
import { read } from "./reads.ts";
import { post } from "./writes.ts";
import type { NewAnswer } from "./types.ts";
import type { Tally, TaskView } from "./schema.ts";

/**
 * The next task for this person, or the one that they hold, with `ahead` that follow; null when nothing is left.
 * `vertex_id` comes first.
 */
export const nextTask = async (
  detection_id: string,
  camera: string,
  skip: string | null,
  ahead: number,
  vertex_id: string | null,
): Promise<TaskView | null> =>
  (await post("/v1/detections/{detection_id}/tasks/next", { detection_id }, { camera, skip, ahead, vertex_id })) ??
  null;

/** The same answer sent again is the same: its id says so. */
export const answerTask = (task_id: string, answer: NewAnswer, signal: AbortSignal) =>
  post("/v1/tasks/{task_id}/answer", { task_id }, answer, { signal });

/** Takes the answer of this version back. The task is this person's again; the same id twice does it once. */
export const undoAnswer = (task_id: string, id: string, version: number) =>
  post("/v1/tasks/{task_id}/undo", { task_id }, { id, version });

export const progress = (id: string, camera: string) =>
  read("/v1/detections/{detection_id}/progress", { detection_id: id }, { camera });

/** Which sweeps have answers, and which have this person's. */
export const answered = (detection_id: string, camera: string) =>
  read("/v1/detections/{detection_id}/answered", { detection_id }, { camera });

/** Read when somebody asks for it: from then on their answers count as reviewed. */
export const tally = (id: string, camera: string): Promise<Tally> =>
  bodyOf(
    client.GET("/v1/detections/{detection_id}/tally", { params: { path: { detection_id: id }, query: { camera } } }),
  );

/** Where to look for each corner that the machine marked. */
export const expectedCorners = (detection_id: string, camera: string) =>
  read("/v1/detections/{detection_id}/expected-corners", { detection_id }, { camera });

export const markingWork = (id: string) => read("/v1/fleets/{id}/marking-work", { id });
