/** Keeps the last answers of a loader by address. */

/** A loader that keeps the `kept` answers asked for last; asked for one twice, it loads it once. A failure is not kept.
 * `drop` gets each answer that is no longer kept. */
export function keepRecent<Loaded>(
  kept: number,
  load: (url: string) => Promise<Loaded>,
  drop: (loaded: Loaded) => void = () => undefined,
): (url: string) => Promise<Loaded> {
  const cache = new Map<string, Promise<Loaded>>();
  return (url) => {
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
      if (cache.size <= kept) break;
      cache.delete(oldest);
      dropped.then(drop, () => undefined);
    }
    return loading;
  };
}
