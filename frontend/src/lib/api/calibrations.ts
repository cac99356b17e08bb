/** Correspondence sets, calibrations, results and what a vehicle's camera is given. */

import { all, create, get, post, query, request, type Page } from "./http.ts";
import type { Calibration, CalibrationRequest, CorrespondenceSet } from "./types/calibrations.ts";
import type { CurrentCalibration, Publication, Result } from "./types/results.ts";

export const buildSet = (detectionId: string, camera: string, excludeFlagged: boolean): Promise<CorrespondenceSet> =>
  create<CorrespondenceSet>(`/detections/${detectionId}/correspondence-sets`, {
    camera,
    exclude_flagged: excludeFlagged,
  });

export const importSet = async (rigId: string, camera: string, file: File): Promise<CorrespondenceSet> =>
  (
    await request<CorrespondenceSet>("POST", `/rigs/${rigId}/correspondence-sets${query({ camera })}`, {
      body: await file.text(),
      creates: true,
      headers: { "Content-Type": file.name.toLowerCase().endsWith(".json") ? "application/json" : "text/csv" },
    })
  ).data;

export const correspondenceSets = (rigId: string): Promise<CorrespondenceSet[]> =>
  all<CorrespondenceSet>(`/rigs/${rigId}/correspondence-sets`);

export const createCalibration = (vehicleId: string, body: CalibrationRequest): Promise<Calibration> =>
  create<Calibration>(`/vehicles/${vehicleId}/calibrations`, body);

export const calibrations = (vehicleId: string): Promise<Calibration[]> =>
  all<Calibration>(`/vehicles/${vehicleId}/calibrations`, 200);

export const calibration = (id: string): Promise<Calibration> => get<Calibration>(`/calibrations/${id}`);

export const cancelCalibration = (id: string): Promise<unknown> => post(`/calibrations/${id}/cancel`);

export const result = (id: string): Promise<Result> => get<Result>(`/results/${id}`);

export const resultUrl = (id: string): string => `/v1/results/${id}`;

/** Gives a result to its camera. `reason` also overrides the service's objections where `against` them. */
export const publish = (resultId: string, reason?: string, against = false): Promise<unknown> =>
  create(`/results/${resultId}/publication`, against ? { override: { reason } } : reason ? { reason } : {});

export const PUBLICATIONS_PER_PAGE = 10;

export const publications = (vehicleId: string, camera: string, after: string | null): Promise<Page<Publication>> =>
  get<Page<Publication>>(
    `/vehicles/${vehicleId}/cameras/${encodeURIComponent(camera)}/publications${query({ after, limit: PUBLICATIONS_PER_PAGE })}`,
  );

export const currentUrl = (vehicleId: string, camera: string): string =>
  `/v1/vehicles/${vehicleId}/cameras/${encodeURIComponent(camera)}/calibration`;

export const current = (vehicleId: string, camera: string): Promise<CurrentCalibration> =>
  get<CurrentCalibration>(`/vehicles/${vehicleId}/cameras/${encodeURIComponent(camera)}/calibration`);
