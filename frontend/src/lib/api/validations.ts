/** Calibrations tested on other pairs and drives. */

import { read, type Read } from "./reads.ts";
import { isUnderWay, type Validations } from "./types.ts";

export const validations = (vehicle_id: string): Read<Validations> =>
  read("/v1/vehicles/{vehicle_id}/validations", { vehicle_id }, { limit: 10 }, (page) =>
    page.items.some((one) => isUnderWay(one)),
  );
