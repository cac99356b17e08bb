/** Marking: tasks one after the other, and taking an answer back. */

import { get, post, query, request } from "./http.ts";
import type { MarkingProgress, MarkingTask, MarkPoint, TaskAnswer, VerdictName } from "./types/annotations.ts";

/** The next task for this person, the one that they hold, or null when nothing is left. */
export async function nextTask(detectionId: string, camera: string, skip: string | null): Promise<MarkingTask | null> {
  const body = skip ? { camera, skip } : { camera };
  const answer = await request<MarkingTask>("POST", `/detections/${detectionId}/tasks/next`, { body });
  return answer.status === 204 ? null : answer.data;
}

export const answerTask = (taskId: string, verdict: VerdictName, mark: MarkPoint | null): Promise<TaskAnswer> =>
  post<TaskAnswer>(`/tasks/${taskId}/answer`, { verdict, mark: mark && { u: mark.u, v: mark.v } });

export const deleteMark = (recordingId: string, camera: string, frameIndex: number): Promise<unknown> =>
  request("DELETE", `/recordings/${recordingId}/cameras/${encodeURIComponent(camera)}/frames/${frameIndex}/mark`);

export const progress = (detectionId: string, camera: string): Promise<MarkingProgress> =>
  get<MarkingProgress>(`/detections/${detectionId}/progress${query({ camera })}`);

export const deleteVerdict = (vertexId: string): Promise<unknown> => request("DELETE", `/vertices/${vertexId}/verdict`);
