/** SHA-256 of upload parts. A worker computes it, so that the page goes on meanwhile. */

let worker: Worker | undefined;

/** The digest of a part. `crypto.subtle` would not do: browsers offer it only over https or on localhost. */
export function sha256(part: Blob): Promise<Uint8Array> {
  worker ??= new Worker(new URL("./digests.worker.ts", import.meta.url), { type: "module" });
  const { port1, port2 } = new MessageChannel();
  worker.postMessage(part, [port2]);
  return new Promise((resolve, reject) => {
    port1.onmessage = ({ data }: MessageEvent<Uint8Array | string>) => {
      port1.close();
      if (typeof data === "string") reject(new Error(data));
      else resolve(data);
    };
  });
}

export function hex(bytes: Uint8Array): string {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export function base64(bytes: Uint8Array): string {
  return btoa(String.fromCharCode(...bytes));
}
