/** Fleets, vehicles and rigs. */

import { bodyOf, client, once } from "./http.ts";
import { read, readAll, type Read } from "./reads.ts";
import type { HealthOrder } from "./types.ts";
import type {
  CameraState,
  FleetHealth,
  FleetOut,
  NewRig,
  PublicationPolicy,
  RigOut,
  SensorSerials,
  VehicleOut,
} from "./schema.ts";

export const fleet = (id: string | undefined): Read<FleetOut> => read("/v1/fleets/{id}", { id });

export const createFleet = (name: string): Promise<FleetOut> =>
  bodyOf(client.POST("/v1/fleets", { body: { name }, ...once() }));

/** As many vehicles as the pages list; larger fleets are named by patterns. */
export const MOST_VEHICLES = 1000;

export const vehicles = (fleetId: string | undefined): Read<VehicleOut[]> =>
  readAll("/v1/fleets/{id}/vehicles", { id: fleetId }, {}, undefined, MOST_VEHICLES);

/** A page of the fleet's cameras, a hundred of them. */
export const health = (
  id: string | undefined,
  filter: { name?: string; state?: CameraState[]; order?: HealthOrder },
  after: string | undefined,
): Read<FleetHealth> => read("/v1/fleets/{id}/health", { id }, { ...filter, after });

export const vehicle = (id: string | undefined): Read<VehicleOut> => read("/v1/vehicles/{id}", { id });

export const createVehicle = (fleetId: string, name: string): Promise<VehicleOut> =>
  bodyOf(client.POST("/v1/fleets/{id}/vehicles", { params: { path: { id: fleetId } }, body: { name }, ...once() }));

export const rigs = (vehicleId: string): Read<RigOut[]> => readAll("/v1/vehicles/{id}/rigs", { id: vehicleId });

export const rig = (id: string): Read<RigOut> => read("/v1/rigs/{id}", { id });

export const createRig = (vehicleId: string, body: NewRig): Promise<{ id: string }> =>
  bodyOf(client.POST("/v1/vehicles/{id}/rigs", { params: { path: { id: vehicleId } }, body, ...once() }));

export const deleteVehicle = (id: string): Promise<unknown> =>
  client.DELETE("/v1/vehicles/{id}", { params: { path: { id } } });

export const deleteRig = (id: string): Promise<unknown> => client.DELETE("/v1/rigs/{id}", { params: { path: { id } } });

const asRead = (version: number) => ({ "If-Match": `"v${version}"` });

/** States what results must show to be published; no limit at all states nothing. */
export const putPolicy = (
  of: "fleets" | "rigs",
  id: string,
  version: number,
  body: PublicationPolicy,
): Promise<unknown> => {
  const options = { params: { path: { id } }, body, headers: asRead(version) };
  return of === "fleets" ? client.PUT("/v1/fleets/{id}/policy", options) : client.PUT("/v1/rigs/{id}/policy", options);
};

/** Corrects whether a camera's images are raw or rectified; null lets the next recording tell it. */
export const patchImages = (
  { id, version }: RigOut,
  name: string,
  kind: "raw" | "rectified" | null,
): Promise<unknown> => {
  const body = { cameras: { [name]: kind && { kind } } };
  return client.PATCH("/v1/rigs/{id}/images", { params: { path: { id } }, body, headers: asRead(version) });
};

/** Corrects serial numbers; those left out stay. */
export const patchSerials = ({ id, version }: RigOut, body: SensorSerials): Promise<unknown> =>
  client.PATCH("/v1/rigs/{id}/serials", { params: { path: { id } }, body, headers: asRead(version) });
