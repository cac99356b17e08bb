/** Axes of plots: round numbers between two ends. */

/** At most `most` numbers, 1, 2 or 5 times a power of ten apart, from `low` to `high`. */
export function ticks(low: number, high: number, most: number): number[] {
  const span = high - low;
  if (!(span > 0) || most < 1) return [low];
  const rough = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map((factor) => factor * rough).find((one) => span / one <= most) ?? 10 * rough;
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: count }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

export type Range = [number, number];
export type Scale = (value: number) => number;

/** From the least to the largest of the numbers, and of `within`, with a margin. */
export function rangeOf(values: Iterable<number>, margin = 0.04, within: readonly number[] = []): Range {
  let [low, high] = [Math.min(...within), Math.max(...within)];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!(low <= high)) return [0, 1];
  const room = margin * (high - low) || 0.5;
  return [within.includes(low) ? low : low - room, high + room];
}

const MINUTE = 60_000;
const DAY = 1440 * MINUTE;
const STEPS = [1, 5, 15, 60, 180, 720].map((minutes) => minutes * MINUTE);
const DAYS = [1, 2, 7, 14, 30, 91, 182, 365, 730, 1825].map((days) => days * DAY);

/** At most `most` moments from `low` to `high` (milliseconds since 1970), and as what they are written. */
export function timeTicks(low: number, high: number, most: number): { at: number; said: string }[] {
  const step = [...STEPS, ...DAYS].find((one) => (high - low) / one <= most) ?? 3650 * DAY;
  // Whole hours and days are those of the reader's time zone.
  const zone = new Date(low).getTimezoneOffset() * MINUTE;
  const first = Math.ceil((low - zone) / step) * step + zone;
  const options: Intl.DateTimeFormatOptions =
    step < DAY ? { hour: "2-digit", minute: "2-digit" } : { day: "numeric", month: "short" };
  if (step > 91 * DAY) options.year = "numeric";
  const count = Math.max(0, Math.floor((high - first) / step) + 1);
  return Array.from({ length: count }, (_, i) => {
    const at = first + i * step;
    return { at, said: new Date(at).toLocaleString("en-GB", options) };
  });
}
