/** Calibrations tested on other pairs and drives, and how a camera's results drift. */

import { read, type Read } from "./reads.ts";
import { isUnderWay, type Drift, type Validations } from "./types.ts";

export const VALIDATIONS_PER_PAGE = 10;
export const DRIFT_PER_PAGE = 20;

export const validations = (vehicle_id: string, after: string | undefined): Read<Validations> =>
  read("/v1/vehicles/{vehicle_id}/validations", { vehicle_id }, { after, limit: VALIDATIONS_PER_PAGE }, (page) =>
    page.items.some((one) => isUnderWay(one)),
  );

export const drift = (vehicle_id: string, camera: string, after: string | undefined): Read<Drift> =>
  read("/v1/vehicles/{vehicle_id}/drift", { vehicle_id }, { camera, after, limit: DRIFT_PER_PAGE });
