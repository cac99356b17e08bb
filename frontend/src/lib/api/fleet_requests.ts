/** Fleet requests: calibrations of all vehicles that a filter names, in one call. */

import { read } from "./reads.ts";
import { create, post } from "./writes.ts";
import { isUnderWay, type VehicleState } from "./types.ts";
import type { DryRunView, FleetRequestBody } from "./schema.ts";

export const REQUESTS_PER_PAGE = 50;
export const VEHICLES_PER_PAGE = 100;

export const createFleetRequest = (id: string, body: FleetRequestBody) =>
  create("/v1/fleets/{id}/fleet-requests", { id }, body) as Promise<{ id: string }>;

/** What the request would come to; nothing is made. */
export const dryRun = (id: string, body: FleetRequestBody) =>
  post("/v1/fleets/{id}/fleet-requests", { id }, { ...body, dry_run: true }) as Promise<DryRunView>;

/** Newest first. */
export const fleetRequests = (fleetId: string, after: string | undefined) =>
  read("/v1/fleets/{id}/fleet-requests", { id: fleetId }, { after, limit: REQUESTS_PER_PAGE }, ({ items }) =>
    items.some(isUnderWay),
  );

export const fleetRequest = (fleet_request_id: string) =>
  read("/v1/fleet-requests/{fleet_request_id}", { fleet_request_id }, {}, isUnderWay);

/** By name; of one state, or of all. */
export const requestVehicles = (fleet_request_id: string, state: VehicleState | undefined, after: string | undefined) =>
  read(
    "/v1/fleet-requests/{fleet_request_id}/vehicles",
    { fleet_request_id },
    { state, after, limit: VEHICLES_PER_PAGE },
  );

export const cancelFleetRequest = (fleet_request_id: string) =>
  post("/v1/fleet-requests/{fleet_request_id}/cancel", { fleet_request_id });

export const retryFleetRequest = (fleet_request_id: string) =>
  post("/v1/fleet-requests/{fleet_request_id}/retry", { fleet_request_id });
