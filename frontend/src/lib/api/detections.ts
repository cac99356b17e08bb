/** Regions of interest, detection runs and their vertices, and the offset between the clocks. */

import { bodyOf, client, once } from "./http.ts";
import type { Corner } from "../corners.ts";
import { read, readAll, type Read } from "./reads.ts";
import {
  isUnderWay,
  type ClockOffset,
  type Detection,
  type DetectionRequest,
  type RegionNode,
  type RegionPreview,
  type RegionSuggestion,
  type Vertex,
  type VertexDetails,
} from "./types.ts";

const POLL_MS = 400;

export const createPreview = (recording_id: string, region: RegionNode): Promise<RegionPreview> =>
  bodyOf(
    client.POST("/v1/recordings/{recording_id}/region-previews", {
      params: { path: { recording_id } },
      body: { region },
      ...once(),
    }),
  );

export const preview = (id: string): Promise<RegionPreview> =>
  bodyOf(client.GET("/v1/region-previews/{preview_id}", { params: { path: { preview_id: id } } }));

export const createSuggestion = (recording_id: string): Promise<RegionSuggestion> =>
  bodyOf(
    client.POST("/v1/recordings/{recording_id}/region-suggestions", {
      params: { path: { recording_id } },
      body: {},
      ...once(),
    }),
  );

export const suggestion = (id: string): Promise<RegionSuggestion> =>
  bodyOf(client.GET("/v1/region-suggestions/{suggestion_id}", { params: { path: { suggestion_id: id } } }));

export const createOffset = (recording_id: string, detection_id: string, camera: string): Promise<ClockOffset> =>
  bodyOf(
    client.POST("/v1/recordings/{recording_id}/clock-offsets", {
      params: { path: { recording_id } },
      body: { detection_id, camera },
      ...once(),
    }),
  );

export const offset = (id: string): Promise<ClockOffset> =>
  bodyOf(client.GET("/v1/clock-offsets/{offset_id}", { params: { path: { offset_id: id } } }));

/** Reads a study until it has ended, and tells of each reading. */
export async function untilEnded<S extends { id: string; state: string }>(
  asked: S,
  read: (id: string) => Promise<S>,
  tell: (study: S) => void,
): Promise<S> {
  for (let study = asked; ; study = await read(study.id)) {
    tell(study);
    if (!isUnderWay(study)) return study;
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
}

export const createDetection = (recording_id: string, body: DetectionRequest): Promise<unknown> =>
  client.POST("/v1/recordings/{recording_id}/detections", {
    params: { path: { recording_id } },
    body,
    ...once(),
  });

/** The detections of a recording that is ready. */
export const detections = (recording_id: string | undefined): Read<Detection[]> =>
  readAll("/v1/recordings/{recording_id}/detections", { recording_id }, {}, (found) =>
    found.some((one) => isUnderWay(one) || areCornersUnderWay(one)),
  );

/** Whether jobs still make the vertices of corners that were asked for after the detection. */
export const areCornersUnderWay = ({ state, job }: Detection): boolean =>
  state === "done" && job !== null && isUnderWay(job);

export const detection = (detection_id: string): Read<Detection> =>
  read("/v1/detections/{detection_id}", { detection_id });

export const cancelDetection = (detection_id: string): Promise<unknown> =>
  client.POST("/v1/detections/{detection_id}/cancel", { params: { path: { detection_id } } });

/** Says which corners of the board people are to mark. */
export const askCorners = (detection_id: string, marked_corners: Corner[]): Promise<unknown> =>
  client.PATCH("/v1/detections/{detection_id}", { params: { path: { detection_id } }, body: { marked_corners } });

/** A detection's vertices; no answer of a person changes them. */
export const vertices = (detection_id: string): Read<Vertex[]> =>
  readAll("/v1/detections/{detection_id}/vertices", { detection_id }, { limit: 5000 }, undefined, 200_000);

/** A vertex with its covariance, its frames and the board's other corners. */
export const vertex = (detection_id: string, vertex_id: string | undefined): Read<VertexDetails> =>
  read("/v1/detections/{detection_id}/vertices/{vertex_id}", { detection_id, vertex_id });
