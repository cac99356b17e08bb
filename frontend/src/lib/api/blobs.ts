/** Bytes straight to and from the service's blob store, at addresses that the service hands out. */

import { ApiProblem, bodyOf, client, send } from "./http.ts";
import type { BlobAddress } from "./schema.ts";

/** Puts one part into the store and says so; `sha256` is its digest in hexadecimal. */
export async function putIntoStore(
  id: string,
  number: number,
  bytes: Blob,
  sha256: string,
  signal: AbortSignal,
): Promise<void> {
  const params = { path: { id, number } };
  const asked = { size: bytes.size, sha256 };
  const address = await bodyOf(
    client.POST("/v1/recordings/{id}/parts/{number}/address", { params, body: asked, signal }),
  );
  // Without an address the service has these bytes already.
  if (!address.url || !address.reservation) return;
  // The address is all that the store asks for; it must never see this site's cookies.
  const put = await fetchFromStore(address.url, { method: "PUT", body: bytes, signal });
  if (!put.ok) throw refused(put.status);
  const body = { reservation: address.reservation };
  await client.POST("/v1/recordings/{id}/parts/{number}/arrival", { params, body, signal });
}

let throughService = false;

/** A frame's image or a sweep: straight from the store, or through the service. */
export const bytesAt = async (url: string): Promise<Blob> =>
  (await fromStore(url)) ?? (await (await send(new Request(url))).blob());

/** Null where these go through the service. */
async function fromStore(url: string): Promise<Blob | null> {
  if (throughService) return null;
  const address = (await (await send(new Request(`${url}/address`))).json()) as BlobAddress;
  if (!address.url) {
    throughService = true;
    return null;
  }
  const from = address.offset ?? 0;
  const range = `bytes=${from}-${from + address.length - 1}`;
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
