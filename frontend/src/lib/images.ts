/** Camera frames fetched and decoded ahead of the moment when they are shown. */

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
  const image = new Image();
  image.decoding = "async";
  image.src = url;
  const loading = image.decode().then(
    () => image,
    () => {
      cache.delete(url);
      throw new Error("The camera frame could not be loaded.");
    },
  );
  cache.set(url, loading);
  for (const oldest of cache.keys()) {
    if (cache.size <= KEPT) break;
    cache.delete(oldest);
  }
  return loading;
}

/** Fetches ahead; a failure shows when the image is really asked for. */
export function preload(url: string): void {
  loadImage(url).catch(() => undefined);
}
