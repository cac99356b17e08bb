/** Regions of interest, detection runs and their vertices. */

import { all, create, get, post, query } from "./http.ts";
import type { Region } from "../region.ts";
import type { Detection, RegionPreview, Vertex } from "./types.ts";

export const createPreview = (recordingId: string, region: Region): Promise<RegionPreview> =>
  create<RegionPreview>(`/recordings/${recordingId}/region-previews`, { region });

export const preview = (id: string): Promise<RegionPreview> => get<RegionPreview>(`/region-previews/${id}`);

export interface DetectionRequest {
  region: Region;
  detector: string;
  options: Record<string, unknown>;
  pairing: { offset_ns: number; max_gap_ns: number };
}

export const createDetection = (recordingId: string, body: DetectionRequest): Promise<Detection> =>
  create<Detection>(`/recordings/${recordingId}/detections`, body);

export const detections = (recordingId: string): Promise<Detection[]> =>
  all<Detection>(`/recordings/${recordingId}/detections`);

export const detection = (id: string): Promise<Detection> => get<Detection>(`/detections/${id}`);

export const cancelDetection = (id: string): Promise<unknown> => post(`/detections/${id}/cancel`);

export const vertices = (id: string, camera: string): Promise<Vertex[]> =>
  all<Vertex>(`/detections/${id}/vertices${query({ camera })}`, 5000);
