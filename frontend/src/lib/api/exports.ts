/** Calibrations in the formats of other programs. */

import { send } from "./http.ts";
import { read, type Read } from "./reads.ts";
import type { components } from "./schema.ts";

export type ExportFormat = components["schemas"]["FormatView"];

export const exportFormats = (): Read<ExportFormat[]> => read("/v1/export-formats", undefined);

/** What stands at `url` in a format, and the name that the service gives to the file. */
export async function exportTo(url: string, format: string): Promise<{ name: string; content: Blob }> {
  const response = await send(new Request(`${url}?format=${encodeURIComponent(format)}`));
  const named = /filename="([^"]+)"/.exec(response.headers.get("content-disposition") ?? "");
  return { name: named?.[1] ?? format, content: await response.blob() };
}
