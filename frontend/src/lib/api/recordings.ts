/** Recordings, their upload in parts, and their camera frames. */

import { bodyOf, client, send } from "./http.ts";
import { read, readAll } from "./reads.ts";
import { change, create, post, type Sending } from "./writes.ts";
import { isUnderWay, type ProposalRequest, type RigProposal } from "./types.ts";
import type { CameraLens, NewRecording, Parts, RecordingEdit, RecordingView } from "./schema.ts";

const of = (id: string) => ({ params: { path: { id } } });

export const recordings = (of: { fleet_id?: string | undefined; vehicle_id?: string }) => ({
  ...readAll("/v1/recordings", undefined, of, (found) => found.some(isUnderWay)),
  enabled: Object.values(of).every((id) => id !== undefined),
});

export const recording = (id: string | undefined) => read("/v1/recordings/{id}", { id }, {}, isUnderWay);

export const createRecording = (id: string, body: NewRecording) => create("/v1/vehicles/{id}/recordings", { id }, body);

/** Which parts the service holds, and how the others go. */
export const uploadedParts = (id: string): Promise<Parts> => bodyOf(client.GET("/v1/recordings/{id}/parts", of(id)));

/** Puts one part; `digest` is its SHA-256 in base64. */
export const putPart = (
  id: string,
  number: number,
  body: Blob,
  digest: string,
  signal: AbortSignal,
): Promise<unknown> => {
  const headers = { "Content-Type": "application/octet-stream", "Content-Digest": `sha-256=:${digest}:` };
  return send(new Request(`/v1/recordings/${id}/parts/${number}`, { method: "PUT", body, headers, signal }));
};

export const completeUpload = (id: string, parts: number, size: number) =>
  create("/v1/recordings/{id}/complete", { id }, { parts, size });

export const retryRecording = (id: string) => post("/v1/recordings/{id}/retry", { id });

export const changeRecording = ({ id, version }: RecordingView, body: RecordingEdit) =>
  change("patch", "/v1/recordings/{id}", { id }, body, version);

/** States a camera's lens. */
export const stateLens = ({ id, version }: RecordingView, camera: string, body: CameraLens) =>
  change("put", "/v1/recordings/{id}/cameras/{camera}/lens", { id, camera }, body, version);

/** The rig that a recording proposes, with a URDF and what a person answers. Nothing is stored. */
export const proposeRig = async (recording_id: string, body: ProposalRequest) =>
  (await post("/v1/recordings/{recording_id}/rig-proposals", { recording_id }, body)) as unknown as RigProposal;

export const deleteRecording = async (id: string, with_published: boolean, sending?: Sending): Promise<unknown> =>
  bodyOf(client.DELETE("/v1/recordings/{id}", { params: { path: { id }, query: { with_published } }, ...sending }));

export const originalUrl = (id: string): string => `/v1/recordings/${id}/original`;

export const frameUrl = (id: string, camera: string, index: number): string =>
  `/v1/recordings/${id}/cameras/${encodeURIComponent(camera)}/frames/${index}`;

/** Where each sweep of the LiDAR is, once a worker has packed them. */
export const sweeps = (id: string | undefined) =>
  readAll("/v1/recordings/{id}/sweeps", { id }, { limit: 5000 }, undefined, 200_000);

/** When each frame of a camera was taken. */
export const frames = (id: string | undefined, camera: string) =>
  readAll("/v1/recordings/{id}/cameras/{camera}/frames", { id, camera }, { limit: 5000 }, undefined, 200_000);

export const sweepUrl = (id: string, index: number): string => `/v1/recordings/${id}/sweeps/${index}`;
