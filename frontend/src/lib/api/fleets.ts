/** Fleets, vehicles and rigs. */

import { read, readAll } from "./reads.ts";
import { change, create, remove, type Sending } from "./writes.ts";
import type { HealthOrder } from "./types.ts";
import type { CameraState, CameraWork, NewRig, PublicationPolicy, RigOut, SensorSerials } from "./schema.ts";

export const fleet = (id: string | undefined) => read("/v1/fleets/{id}", { id });

export const createFleet = (name: string) => create("/v1/fleets", {}, { name });

/** As many vehicles as the pages list; larger fleets are named by patterns. */
export const MOST_VEHICLES = 1000;

export const vehicles = (fleetId: string | undefined) =>
  readAll("/v1/fleets/{id}/vehicles", { id: fleetId }, {}, undefined, MOST_VEHICLES);

/** A page of the fleet's cameras, a hundred of them. */
export const health = (
  id: string | undefined,
  filter: { name?: string; state?: CameraState[]; work?: CameraWork[]; order?: HealthOrder },
  after: string | undefined,
) => read("/v1/fleets/{id}/health", { id }, { ...filter, after });

export const vehicle = (id: string | undefined) => read("/v1/vehicles/{id}", { id });

export const createVehicle = (id: string, name: string) => create("/v1/fleets/{id}/vehicles", { id }, { name });

export const rigs = (vehicleId: string) => readAll("/v1/vehicles/{id}/rigs", { id: vehicleId });

export const rig = (id: string) => read("/v1/rigs/{id}", { id });

export const createRig = (id: string, body: NewRig, sending?: Sending) =>
  create("/v1/vehicles/{id}/rigs", { id }, body, sending);

export const deleteVehicle = (id: string, sending?: Sending) => remove("/v1/vehicles/{id}", { id }, sending);

export const deleteRig = (id: string, sending?: Sending) => remove("/v1/rigs/{id}", { id }, sending);

/** States what results must show to be published; no limit at all states nothing. */
export const putPolicy = (of: "fleets" | "rigs", id: string, version: number, body: PublicationPolicy) =>
  change("put", of === "fleets" ? "/v1/fleets/{id}/policy" : "/v1/rigs/{id}/policy", { id }, body, version);

/** Corrects whether a camera's images are raw or rectified; null lets the next recording tell it. */
export const patchImages = (
  { id, version }: RigOut,
  name: string,
  kind: "raw" | "rectified" | null,
  sending?: Sending,
) => change("patch", "/v1/rigs/{id}/images", { id }, { cameras: { [name]: kind && { kind } } }, version, sending);

/** Corrects serial numbers; those left out stay. */
export const patchSerials = ({ id, version }: RigOut, body: SensorSerials, sending?: Sending) =>
  change("patch", "/v1/rigs/{id}/serials", { id }, body, version, sending);
