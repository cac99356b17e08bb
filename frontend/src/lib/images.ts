/** Camera frames fetched and decoded ahead of the moment when they are shown. */

import { bytesAt } from "./api/blobs.ts";
import { keepRecent } from "./recent.ts";

/** Decoded ones take 8 MB each, files a thirtieth of that. */
const KEPT = 12;
const KEPT_FILES = 64;

/** The file of a frame, kept so that it is there without a network. */
export const loadFile = keepRecent(KEPT_FILES, bytesAt);

/** The decoded image of an address; asked for twice, it is fetched once. */
export const loadImage = keepRecent(KEPT, load, release);

async function load(url: string): Promise<HTMLImageElement> {
  const file = await loadFile(url);
  const image = new Image();
  image.decoding = "async";
  // The element that shows the image has the words for it.
  image.alt = "";
  image.src = URL.createObjectURL(file);
  try {
    await image.decode();
  } catch {
    release(image);
    throw new Error("The camera frame could not be loaded.");
  }
  return image;
}

function release(image: HTMLImageElement): void {
  URL.revokeObjectURL(image.src);
}

/** Fetches ahead; a failure shows when the image is really asked for. */
export function preload(url: string): void {
  loadImage(url).catch(() => undefined);
}
