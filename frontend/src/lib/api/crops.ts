/** Pages of crops, on which people confirm the machine's marks. */

import { read } from "./reads.ts";
import { post } from "./writes.ts";
import type { CropAnswer, CropSheet } from "./schema.ts";

export const progress = (detection_id: string, camera: string) =>
  read("/v1/detections/{detection_id}/crops", { detection_id }, { camera });

/** The page that this person has not answered, or a new one; null where no mark needs a look. */
export const nextPage = async (detection_id: string, camera: string): Promise<CropSheet | null> =>
  (await post("/v1/detections/{detection_id}/crops/next", { detection_id }, { camera })) ?? null;

/** The same answer sent again is the same: its id says so. */
export const answerPage = (page_id: string, body: CropAnswer) =>
  post("/v1/crop-pages/{page_id}/answer", { page_id }, body);
