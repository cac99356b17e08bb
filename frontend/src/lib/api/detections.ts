/** Regions of interest, detection runs and their vertices, and the offset between the clocks. */

import { all, create, get, post, query } from "./http.ts";
import type { Region } from "../region.ts";
import type { Detection, Pairing, Vertex } from "./types/detections.ts";
import type { Study } from "./types/jobs.ts";
import type { ClockOffset, RegionPreview, RegionSuggestion } from "./types/studies.ts";

export const createPreview = (recordingId: string, region: Region): Promise<RegionPreview> =>
  create<RegionPreview>(`/recordings/${recordingId}/region-previews`, { region });

export const preview = (id: string): Promise<RegionPreview> => get<RegionPreview>(`/region-previews/${id}`);

export const createSuggestion = (recordingId: string): Promise<RegionSuggestion> =>
  create<RegionSuggestion>(`/recordings/${recordingId}/region-suggestions`, {});

export const suggestion = (id: string): Promise<RegionSuggestion> => get<RegionSuggestion>(`/region-suggestions/${id}`);

export const createOffset = (recordingId: string, detectionId: string, camera: string): Promise<ClockOffset> =>
  create<ClockOffset>(`/recordings/${recordingId}/clock-offsets`, { detection_id: detectionId, camera });

export const offset = (id: string): Promise<ClockOffset> => get<ClockOffset>(`/clock-offsets/${id}`);

const POLL_MS = 400;

/** Reads a study until it has ended, and tells of each reading. */
export async function follow<S extends Study<unknown>>(
  asked: S,
  read: (id: string) => Promise<S>,
  tell: (study: S) => void,
): Promise<S> {
  let study = asked;
  for (;;) {
    tell(study);
    if (study.state !== "queued" && study.state !== "running") return study;
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    study = await read(study.id);
  }
}

export interface DetectionRequest {
  region: Region;
  detector: string;
  options: Record<string, unknown>;
  pairing: Pairing;
}

export const createDetection = (recordingId: string, body: DetectionRequest): Promise<Detection> =>
  create<Detection>(`/recordings/${recordingId}/detections`, body);

export const detections = (recordingId: string): Promise<Detection[]> =>
  all<Detection>(`/recordings/${recordingId}/detections`);

export const detection = (id: string): Promise<Detection> => get<Detection>(`/detections/${id}`);

export const cancelDetection = (id: string): Promise<unknown> => post(`/detections/${id}/cancel`);

export const vertices = (id: string, camera: string): Promise<Vertex[]> =>
  all<Vertex>(`/detections/${id}/vertices${query({ camera })}`, 5000);
