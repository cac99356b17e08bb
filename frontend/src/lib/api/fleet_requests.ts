/** Fleet requests: calibrations of all vehicles that a filter names, in one call. */

import { create, get, post, query, type Page } from "./http.ts";
import type { DryRun, FleetRequest, FleetRequestBody, RequestVehicle, VehicleState } from "./types/fleet_requests.ts";

export const REQUESTS_PER_PAGE = 50;
export const VEHICLES_PER_PAGE = 100;

export const createFleetRequest = (fleetId: string, body: FleetRequestBody): Promise<FleetRequest> =>
  create<FleetRequest>(`/fleets/${fleetId}/fleet-requests`, body);

/** What the request would come to; nothing is made. */
export const dryRun = (fleetId: string, body: FleetRequestBody): Promise<DryRun> =>
  post<DryRun>(`/fleets/${fleetId}/fleet-requests`, { ...body, dry_run: true });

/** Newest first. */
export const fleetRequests = (fleetId: string, after: string | null): Promise<Page<FleetRequest>> =>
  get<Page<FleetRequest>>(`/fleets/${fleetId}/fleet-requests${query({ after, limit: REQUESTS_PER_PAGE })}`);

export const fleetRequest = (id: string): Promise<FleetRequest> => get<FleetRequest>(`/fleet-requests/${id}`);

/** By name; of one state, or of all. */
export const requestVehicles = (
  id: string,
  state: VehicleState | null,
  after: string | null,
): Promise<Page<RequestVehicle>> =>
  get<Page<RequestVehicle>>(`/fleet-requests/${id}/vehicles${query({ state, after, limit: VEHICLES_PER_PAGE })}`);

export const cancelFleetRequest = (id: string): Promise<unknown> => post(`/fleet-requests/${id}/cancel`);

export const retryFleetRequest = (id: string): Promise<unknown> => post(`/fleet-requests/${id}/retry`);
