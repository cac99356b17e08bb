/** Detections and their vertices. */

import type { Corner } from "../corners.ts";
import { read, readAll } from "./reads.ts";
import { change, create, post, remove, type Sending } from "./writes.ts";
import { isUnderWay } from "./types.ts";
import type { DetectionRequest } from "./schema.ts";

export const createDetection = (recording_id: string, body: DetectionRequest) =>
  create("/v1/recordings/{recording_id}/detections", { recording_id }, body);

/** The detections of a recording that is ready. */
export const detections = (recording_id: string | undefined) =>
  readAll("/v1/recordings/{recording_id}/detections", { recording_id }, {}, (found) => found.some(isUnderWay));

export const detection = (detection_id: string) => read("/v1/detections/{detection_id}", { detection_id });

export const cancelDetection = (detection_id: string) => post("/v1/detections/{detection_id}/cancel", { detection_id });

export const deleteDetection = (detection_id: string, sending?: Sending) =>
  remove("/v1/detections/{detection_id}", { detection_id }, sending);

/** Says which corners of the board people are to mark. */
export const askCorners = (detection_id: string, marked_corners: Corner[]) =>
  change("patch", "/v1/detections/{detection_id}", { detection_id }, { marked_corners });

/** A detection's vertices; no answer of a person changes them. */
export const vertices = (detection_id: string) =>
  readAll("/v1/detections/{detection_id}/vertices", { detection_id }, { limit: 5000 }, undefined, 200_000);

/** A vertex with its covariance, its frames and the board's other corners. */
export const vertex = (detection_id: string, vertex_id: string | undefined) =>
  read("/v1/detections/{detection_id}/vertices/{vertex_id}", { detection_id, vertex_id });
