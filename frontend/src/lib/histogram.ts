/** Counts of values in bins of equal width. */

export interface Histogram {
  width: number;
  counts: number[];
}

/** `count` bins from 0 to about the 98th percentile; the last bin also holds everything larger. */
export function histogram(values: readonly number[], count: number): Histogram {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  const high = sorted[Math.min(sorted.length - 1, Math.floor(sorted.length * 0.98))] ?? 1;
  const width = Math.max(high, 1e-9) / count;
  const counts = new Array<number>(count).fill(0);
  for (const value of sorted) {
    const bin = Math.min(count - 1, Math.max(0, Math.floor(value / width)));
    counts[bin] = (counts[bin] ?? 0) + 1;
  }
  return { width, counts };
}
