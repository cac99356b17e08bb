/** Counts of values in bins of equal width. */

export interface Histogram {
  width: number;
  counts: number[];
}

/**
 * `count` bins from 0 to about the 98th percentile of `scale`; the last bin also holds everything larger.
 * Where some values are known to be far off, `scale` is the others: else a few of them press all into the first bin.
 */
export function histogram(values: readonly number[], count: number, scale = values): Histogram {
  const ascending = (some: readonly number[]): number[] => some.filter(Number.isFinite).sort((a, b) => a - b);
  const sorted = ascending(values);
  const scaling = ascending(scale);
  const high = scaling[Math.min(scaling.length - 1, Math.floor(scaling.length * 0.98))] ?? 1;
  const width = Math.max(high, 1e-9) / count;
  const counts = new Array<number>(count).fill(0);
  for (const value of sorted) {
    const bin = Math.min(count - 1, Math.max(0, Math.floor(value / width)));
    counts[bin] = (counts[bin] ?? 0) + 1;
  }
  return { width, counts };
}
