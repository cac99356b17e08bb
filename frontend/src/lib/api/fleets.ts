/** Fleets, vehicles and rigs. */

import { all, create, get } from "./http.ts";
import type { Fleet, Rig, RigRequest, Vehicle } from "./types/fleets.ts";

export const fleet = (id: string): Promise<Fleet> => get<Fleet>(`/fleets/${id}`);

export const createFleet = (name: string): Promise<Fleet> => create<Fleet>("/fleets", { name });

/** As many vehicles as the pages list; larger fleets are named by patterns. */
export const MOST_VEHICLES = 1000;

export const vehicles = (fleetId: string): Promise<Vehicle[]> =>
  all<Vehicle>(`/fleets/${fleetId}/vehicles`, MOST_VEHICLES);

export const vehicle = (id: string): Promise<Vehicle> => get<Vehicle>(`/vehicles/${id}`);

export const createVehicle = (fleetId: string, name: string): Promise<Vehicle> =>
  create<Vehicle>(`/fleets/${fleetId}/vehicles`, { name });

export const rigs = (vehicleId: string): Promise<Rig[]> => all<Rig>(`/vehicles/${vehicleId}/rigs`);

export const rig = (id: string): Promise<Rig> => get<Rig>(`/rigs/${id}`);

export const createRig = (vehicleId: string, rig: RigRequest): Promise<Rig> =>
  create<Rig>(`/vehicles/${vehicleId}/rigs`, rig);
