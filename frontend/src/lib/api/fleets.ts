/** Fleets, vehicles and rigs. */

import { bodyOf, client, once } from "./http.ts";
import { read, readAll, type Read } from "./reads.ts";
import type { Fleet, Rig, RigRequest, Vehicle } from "./types.ts";

export const fleet = (id: string | undefined): Read<Fleet> => read("/v1/fleets/{id}", { id });

export const createFleet = (name: string): Promise<Fleet> =>
  bodyOf(client.POST("/v1/fleets", { body: { name }, ...once() }));

/** As many vehicles as the pages list; larger fleets are named by patterns. */
export const MOST_VEHICLES = 1000;

export const vehicles = (fleetId: string | undefined): Read<Vehicle[]> =>
  readAll("/v1/fleets/{id}/vehicles", { id: fleetId }, {}, undefined, MOST_VEHICLES);

export const vehicle = (id: string | undefined): Read<Vehicle> => read("/v1/vehicles/{id}", { id });

export const createVehicle = (fleetId: string, name: string): Promise<Vehicle> =>
  bodyOf(client.POST("/v1/fleets/{id}/vehicles", { params: { path: { id: fleetId } }, body: { name }, ...once() }));

export const rigs = (vehicleId: string): Read<Rig[]> => readAll("/v1/vehicles/{id}/rigs", { id: vehicleId });

export const rig = (id: string): Read<Rig> => read("/v1/rigs/{id}", { id });

export const createRig = (vehicleId: string, body: RigRequest): Promise<unknown> =>
  client.POST("/v1/vehicles/{id}/rigs", { params: { path: { id: vehicleId } }, body, ...once() });
