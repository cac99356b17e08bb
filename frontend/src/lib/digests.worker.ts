/** Takes parts of an upload and answers each with its SHA-256, or with why it cannot be read. */

import { createSHA256 } from "hash-wasm";

async function digestOf(part: Blob): Promise<Uint8Array> {
  const hasher = await createSHA256();
  const reader = part.stream().getReader();
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) hasher.update(piece.value);
  return hasher.digest("binary");
}

self.onmessage = ({ data: part, ports: [answer] }: MessageEvent<Blob>): void => {
  digestOf(part).then(
    (digest) => answer?.postMessage(digest),
    (error: unknown) => answer?.postMessage(String(error)),
  );
};
