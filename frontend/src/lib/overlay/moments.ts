/** Which sweep belongs to a frame. */

/** The place of the stamp nearest to a moment in a list that rises; -1 in an empty one. */
export function nearest(stamps: readonly { stamp_ns: number }[], moment: number): number {
  let [low, high] = [0, stamps.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((stamps[middle]?.stamp_ns ?? 0) < moment) low = middle + 1;
    else high = middle;
  }
  const away = (i: number): number => Math.abs((stamps[i]?.stamp_ns ?? Infinity) - moment);
  return high > 0 && away(low - 1) < away(low) ? low - 1 : high;
}

/** How long after its stamp a sweep's middle was measured, nanoseconds. */
export function middleOf(timesNs: Float64Array): number {
  let [low, high] = [Infinity, -Infinity];
  for (const time of timesNs) {
    if (time < low) low = time;
    if (time > high) high = time;
  }
  return timesNs.length > 0 ? (low + high) / 2 : 0;
}
