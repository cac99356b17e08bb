/** Camera frames fetched and decoded ahead of the moment when they are shown. */

import { fromStore } from "./api/blobs.ts";
import { keepRecent } from "./recent.ts";

const KEPT = 12;

/** The decoded image of an address; asked for twice, it is fetched once. */
export const loadImage = keepRecent(KEPT, load, release);

async function load(url: string): Promise<HTMLImageElement> {
  const fetched = await fromStore(url);
  const image = new Image();
  image.decoding = "async";
  // The element that shows the image has the words for it.
  image.alt = "";
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
