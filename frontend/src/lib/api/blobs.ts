/** Bytes straight to and from the service's blob store, at addresses that the service hands out. */

import { ApiProblem, get, request } from "./http.ts";
import type { UploadedPart } from "./types/recordings.ts";

/** How a recording's parts go: to the service itself, or to an address of the store that is asked for. */
export interface UploadWay {
  part_bytes: number;
  parts: "api" | "presigned";
}

interface PartAddress {
  /** The part, where the service holds these bytes already. */
  part: UploadedPart | null;
  url: string | null;
  reservation: string | null;
}

interface FrameAddress {
  /** Null where frames go through the service. */
  url: string | null;
  offset: number;
  length: number;
  media_type: string;
}

/** Puts one part into the store and says so; `digest` is its SHA-256 in hexadecimal. */
export async function putIntoStore(
  id: string,
  number: number,
  bytes: ArrayBuffer,
  digest: string,
  signal: AbortSignal,
): Promise<void> {
  const path = `/recordings/${id}/parts/${number}`;
  const asked = { size: bytes.byteLength, sha256: digest };
  const { data: address } = await request<PartAddress>("POST", `${path}/address`, { body: asked, signal });
  if (!address.url) return;
  // The address is all that the store asks for; it must never see this site's cookies.
  const put = await fetchFromStore(address.url, { method: "PUT", body: bytes, signal });
  if (!put.ok) throw refused(put.status);
  await request("POST", `${path}/arrival`, { body: { reservation: address.reservation }, signal });
}

let throughService = false;

/** A frame's image straight from the store; null where frames go through the service. */
export async function frameFromStore(frameUrl: string): Promise<Blob | null> {
  if (throughService) return null;
  const address = await get<FrameAddress>(`${frameUrl.replace(/^\/v1/, "")}/address`);
  if (!address.url) {
    throughService = true;
    return null;
  }
  const range = `bytes=${address.offset}-${address.offset + address.length - 1}`;
  const answer = await fetchFromStore(address.url, { headers: { Range: range } });
  if (answer.status !== 206) throw refused(answer.status);
  return new Blob([await answer.arrayBuffer()], { type: address.media_type });
}

async function fetchFromStore(url: string, init: RequestInit): Promise<Response> {
  try {
    return await fetch(url, { ...init, credentials: "omit", referrerPolicy: "no-referrer" });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new ApiProblem(0, {
      code: "store_unreachable",
      detail: `This browser cannot reach the store at ${new URL(url).host}, where the service keeps recordings.`,
      hint: "Check that this computer is online. The operator should look at the store's address and its CORS rules.",
    });
  }
}

function refused(status: number): ApiProblem {
  // 403 is an address whose time is over: the next try asks for another.
  return new ApiProblem(status === 403 ? 503 : status, {
    code: "store_refused",
    detail: `The store that holds recordings answered ${status}.`,
    hint: "Try again in a moment; if it stays, tell whoever runs the service.",
  });
}
