/** Recordings, their upload in parts, and their camera frames. */

import type { UploadWay } from "./blobs.ts";
import { all, create, get, post, query, request, type Page } from "./http.ts";
import type { Frame, Reading, Recording, UploadedPart } from "./types/recordings.ts";

export const recordings = (filter: { fleet_id?: string; vehicle_id?: string }): Promise<Recording[]> =>
  all<Recording>(`/recordings${query(filter)}`);

export const recording = (id: string): Promise<Recording> => get<Recording>(`/recordings/${id}`);

export interface NewRecording {
  rig_id: string;
  name: string;
  file_name: string;
  size: number;
  marks_per_vertex: number;
}

export const createRecording = (vehicleId: string, body: NewRecording): Promise<Recording> =>
  create<Recording>(`/vehicles/${vehicleId}/recordings`, body);

/** Which parts the service holds, and how the others go. */
export const uploadedParts = (id: string): Promise<{ items: UploadedPart[]; upload: UploadWay }> =>
  get(`/recordings/${id}/parts`);

/** Puts one part; `digest` is its SHA-256 in base64. */
export const putPart = (id: string, number: number, bytes: ArrayBuffer, digest: string, signal: AbortSignal) =>
  request<UploadedPart>("PUT", `/recordings/${id}/parts/${number}`, {
    body: bytes,
    headers: { "Content-Digest": `sha-256=:${digest}:` },
    signal,
  });

export const completeUpload = (id: string, parts: number, size: number): Promise<unknown> =>
  create(`/recordings/${id}/complete`, { parts, size, sha256: null });

export const retryRecording = (id: string): Promise<unknown> => post(`/recordings/${id}/retry`);

export interface RecordingChange {
  name?: string;
  marks_per_vertex?: number;
  reading?: Reading;
}

export const changeRecording = async (recording: Recording, change: RecordingChange) =>
  (
    await request<Recording>("PATCH", `/recordings/${recording.id}`, {
      body: change,
      headers: { "If-Match": `"v${recording.version}"` },
    })
  ).data;

export const deleteRecording = (id: string, withPublished: boolean): Promise<unknown> =>
  request("DELETE", `/recordings/${id}${withPublished ? "?with_published=true" : ""}`);

export const originalUrl = (id: string): string => `/v1/recordings/${id}/original`;

export const frames = (id: string, camera: string, after: number | null): Promise<Page<Frame>> =>
  get<Page<Frame>>(`/recordings/${id}/cameras/${encodeURIComponent(camera)}/frames${query({ after, limit: 1000 })}`);

export const frameUrl = (id: string, camera: string, index: number): string =>
  `/v1/recordings/${id}/cameras/${encodeURIComponent(camera)}/frames/${index}`;
