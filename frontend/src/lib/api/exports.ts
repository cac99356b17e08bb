/** Calibrations in the formats of other programs. */

import { client, send } from "./http.ts";
import { read } from "./reads.ts";
import type { components } from "./schema.ts";

export type ExportFormat = components["schemas"]["FormatView"];

export const exportFormats = () => read("/v1/export-formats", undefined);

/** What stands at `url` in a format, and the name that the service gives to the file. */
export async function exportTo(url: string, format: string): Promise<{ name: string; content: Blob }> {
  const response = await send(new Request(`${url}?format=${encodeURIComponent(format)}`));
  const named = /filename="([^"]+)"/.exec(response.headers.get("content-disposition") ?? "");
  return { name: named?.[1] ?? format, content: await response.blob() };
}

/** The sent URDF with one joint as the camera's current calibration has it. */
export async function patchUrdf(
  vehicleId: string,
  camera: string,
  body: components["schemas"]["UrdfRequest"],
): Promise<Blob> {
  const { data } = await client.POST("/v1/vehicles/{vehicle_id}/cameras/{camera}/calibration/urdf", {
    params: { path: { vehicle_id: vehicleId, camera } },
    body,
    parseAs: "blob",
  });
  return data as unknown as Blob;
}
