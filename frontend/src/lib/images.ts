/** Camera frames fetched and decoded ahead of the moment when they are shown. */

import { fromStore } from "./api/blobs.ts";

const KEPT = 12;
const cache = new Map<string, Promise<HTMLImageElement>>();

/** The decoded image of an address; asked for twice, it is fetched once. */
export function loadImage(url: string): Promise<HTMLImageElement> {
  const known = cache.get(url);
  if (known) {
    cache.delete(url);
    cache.set(url, known);
    return known;
  }
  const loading = load(url).catch((error: unknown) => {
    cache.delete(url);
    throw error;
  });
  cache.set(url, loading);
  for (const [oldest, dropped] of cache) {
    if (cache.size <= KEPT) break;
    cache.delete(oldest);
    dropped.then(release, () => undefined);
  }
  return loading;
}

async function load(url: string): Promise<HTMLImageElement> {
  const fetched = await fromStore(url);
  const image = new Image();
  image.decoding = "async";
  image.src = fetched ? URL.createObjectURL(fetched) : url;
  try {
    await image.decode();
  } catch {
    release(image);
    throw new Error("The camera frame could not be loaded.");
  }
  return image;
}

/** Gives back the memory of an image that came from the store. */
function release(image: HTMLImageElement): void {
  if (image.src.startsWith("blob:")) URL.revokeObjectURL(image.src);
}

/** Fetches ahead; a failure shows when the image is really asked for. */
export function preload(url: string): void {
  loadImage(url).catch(() => undefined);
}
