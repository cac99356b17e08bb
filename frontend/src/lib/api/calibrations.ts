/** Correspondence sets, calibrations, results and what a vehicle's camera is given. */

import { bodyOf, client, once, send } from "./http.ts";
import { read, readAll } from "./reads.ts";
import { create, post, remove, type Sending } from "./writes.ts";
import { isUnderWay } from "./types.ts";
import type { CalibrationFiles, CalibrationRequest, ResultView } from "./schema.ts";

export const buildSet = (detection_id: string, camera: string, exclude_flagged: boolean) =>
  create("/v1/detections/{detection_id}/correspondence-sets", { detection_id }, { camera, exclude_flagged });

export const importSet = async (rigId: string, camera: string, file: File): Promise<unknown> => {
  const type = file.name.toLowerCase().endsWith(".json") ? "application/json" : "text/csv";
  const address = `/v1/rigs/${rigId}/correspondence-sets?camera=${encodeURIComponent(camera)}`;
  const headers = { "Content-Type": type, ...once().headers };
  return send(new Request(address, { method: "POST", body: await file.text(), headers }));
};

export const correspondenceSets = (rig_id: string) => readAll("/v1/rigs/{rig_id}/correspondence-sets", { rig_id });

export const correspondenceSet = (set_id: string | undefined) => read("/v1/correspondence-sets/{set_id}", { set_id });

export const createCalibration = (vehicle_id: string, body: CalibrationRequest) =>
  create("/v1/vehicles/{vehicle_id}/calibrations", { vehicle_id }, body);

export const calibrations = (vehicle_id: string | undefined) =>
  readAll("/v1/vehicles/{vehicle_id}/calibrations", { vehicle_id }, {}, undefined, 200);

export const calibration = (calibration_id: string) =>
  read("/v1/calibrations/{calibration_id}", { calibration_id }, {}, isUnderWay);

export const cancelCalibration = (calibration_id: string) =>
  post("/v1/calibrations/{calibration_id}/cancel", { calibration_id });

export const deleteCalibration = (calibration_id: string, sending?: Sending) =>
  remove("/v1/calibrations/{calibration_id}", { calibration_id }, sending);

export const result = (result_id: string) => read("/v1/results/{result_id}", { result_id });

/** How far a result is from another one of its camera. */
export const comparison = (result_id: string, other: string) =>
  read("/v1/results/{result_id}/comparison", { result_id: other ? result_id : "" }, { other });

export const DRIFT_PER_PAGE = 20;

export const drift = (vehicle_id: string, camera: string, after: string | undefined) =>
  read("/v1/vehicles/{vehicle_id}/drift", { vehicle_id }, { camera, after, limit: DRIFT_PER_PAGE });

/** A result's pairs without those that have these numbers. */
export const selectPairs = ({ set_id }: ResultView, leave_out: number[]) =>
  create("/v1/correspondence-sets/{set_id}/selections", { set_id }, { leave_out });

/** Asks for a result's calibration again, with another set of pairs in place of the result's. */
export async function calibrateWith(found: ResultView, pairs: { id: string }): Promise<{ id: string }> {
  const params = { path: { calibration_id: found.calibration_id } };
  const { request } = await bodyOf(client.GET("/v1/calibrations/{calibration_id}", { params }));
  const ids = (request.correspondence_set_ids ?? []).map((one) => (one === found.set_id ? pairs.id : one));
  // What the service keeps of a request it takes again; its generated type loses the lengths of pairs.
  const again = { ...request, correspondence_set_ids: ids } as CalibrationRequest;
  return createCalibration(found.vehicle_id, again);
}

export const resultUrl = (id: string): string => `/v1/results/${id}`;

/** The alias that vehicles follow if they name none. */
export const CURRENT = "current";

/** Lets an alias lead to a result. With `override` the reason says why, although a check says stop. */
export const publish = (result_id: string, reason?: string, override = false, alias = CURRENT) =>
  create(
    "/v1/results/{result_id}/publication",
    { result_id },
    { alias, ...(override && reason ? { override: { reason } } : { reason: reason ?? null }) },
  );

/** Withdraws what an alias leads to. The camera is given nothing under it until something is published. */
export const withdraw = (publication_id: string, reason: string) =>
  create("/v1/publications/{publication_id}/withdrawal", { publication_id }, { reason });

/** Where each alias of a camera leads. */
export const aliases = (vehicle_id: string, camera: string) =>
  read("/v1/vehicles/{vehicle_id}/cameras/{camera}/aliases", { vehicle_id, camera });

/** What calibration files of other programs hold. Nothing is stored. */
export const readFiles = (body: CalibrationFiles) => post("/v1/calibration-files/reading", {}, body);

/** How far a result is from the camera of that name in the files. */
export const compareWithFiles = (result_id: string, files: CalibrationFiles, camera: string) =>
  post("/v1/results/{result_id}/comparison", { result_id }, { files, camera });

export const PUBLICATIONS_PER_PAGE = 10;

export const publications = (vehicle_id: string, camera: string, alias: string, after: string | undefined) =>
  read(
    "/v1/vehicles/{vehicle_id}/cameras/{camera}/publications",
    { vehicle_id, camera },
    { alias, after, limit: PUBLICATIONS_PER_PAGE },
  );

export const currentUrl = (vehicleId: string, camera: string): string =>
  `/v1/vehicles/${vehicleId}/cameras/${encodeURIComponent(camera)}/calibration`;

export const current = (vehicle_id: string, camera: string) =>
  read("/v1/vehicles/{vehicle_id}/cameras/{camera}/calibration", {
    vehicle_id,
    camera,
  });
