/** Marking: tasks one after the other, answers, and taking one back. */

import { get, post, query, request } from "./http.ts";
import type { MarkingProgress, MarkingTally, MarkingTask, NewAnswer } from "./types/annotations.ts";

/** The next task for this person, the one that they hold, or null when nothing is left. */
export async function nextTask(detectionId: string, camera: string, skip: string | null): Promise<MarkingTask | null> {
  const body = skip ? { camera, skip } : { camera };
  const answer = await request<MarkingTask>("POST", `/detections/${detectionId}/tasks/next`, { body });
  return answer.status === 204 ? null : answer.data;
}

/** The same answer sent again is the same: its id says so. */
export async function answerTask(taskId: string, answer: NewAnswer, signal: AbortSignal): Promise<void> {
  await request("POST", `/tasks/${taskId}/answer`, { body: answer, signal });
}

/** Takes the answer of this version back. The task is this person's again; the same id twice does it once. */
export const undoAnswer = (taskId: string, id: string, version: number): Promise<MarkingTask> =>
  post<MarkingTask>(`/tasks/${taskId}/undo`, { id, version });

export const progress = (detectionId: string, camera: string): Promise<MarkingProgress> =>
  get<MarkingProgress>(`/detections/${detectionId}/progress${query({ camera })}`);

export const tally = (detectionId: string, camera: string): Promise<MarkingTally> =>
  get<MarkingTally>(`/detections/${detectionId}/tally${query({ camera })}`);
