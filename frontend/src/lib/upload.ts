/** Uploading a recording's original file in numbered parts, each with its checksum; resumable. */

import { completeUpload, putPart, uploadedParts } from "./api/recordings.ts";
import { putIntoStore } from "./api/blobs.ts";
import { ApiProblem } from "./api/http.ts";
import { base64, hex, sha256 } from "./digests.ts";

export interface Part {
  number: number;
  start: number;
  end: number;
}

/** How a file of `size` bytes is cut; parts count from 1, an empty file is one empty part. */
export function partsOf(size: number, partBytes: number): Part[] {
  const count = Math.max(1, Math.ceil(size / partBytes));
  return Array.from({ length: count }, (_, i) => ({
    number: i + 1,
    start: i * partBytes,
    end: Math.min(size, (i + 1) * partBytes),
  }));
}

/**
 * Sends what the service does not hold yet, then completes the upload. A part that the service already has is
 * compared by checksum, so continuing with another file is refused by the service instead of mixing the two.
 */
export async function uploadFile(
  recordingId: string,
  file: File,
  onProgress: (sentBytes: number) => void,
  signal: AbortSignal,
): Promise<void> {
  const { items, upload } = await uploadedParts(recordingId);
  const known = new Map(items.map((part) => [part.number, part]));
  const size = known.get(1)?.size ?? upload.part_bytes;
  const parts = partsOf(file.size, known.size > 1 ? size : upload.part_bytes);
  const bytesOf = ({ start, end }: Part): Blob => file.slice(start, end);
  let sent = 0;
  let ahead: Promise<Uint8Array> | undefined;
  for (const part of parts) {
    const bytes = bytesOf(part);
    const digest = await (ahead ?? sha256(bytes));
    // Parts count from 1: the next one is hashed while this one is sent.
    const next = parts[part.number];
    ahead = next && sha256(bytesOf(next));
    // It is awaited in the next turn, where there is one.
    ahead?.catch(() => undefined);
    if (known.get(part.number)?.sha256 !== hex(digest)) {
      await withRetry(signal, () =>
        upload.parts === "presigned"
          ? putIntoStore(recordingId, part.number, bytes, hex(digest), signal)
          : putPart(recordingId, part.number, bytes, base64(digest), signal),
      );
    }
    sent += bytes.size;
    onProgress(sent);
  }
  await completeUpload(recordingId, parts.length, file.size);
}

async function withRetry(signal: AbortSignal, put: () => Promise<unknown>): Promise<void> {
  for (let attempt = 0; ; attempt += 1) {
    try {
      await put();
      return;
    } catch (error) {
      const passing =
        error instanceof ApiProblem && (error.status === 0 || error.status >= 500) && error.status !== 507;
      if (!passing || attempt >= 5 || signal.aborted) throw error;
      await new Promise((resolve) => setTimeout(resolve, 500 * 2 ** attempt));
    }
  }
}
