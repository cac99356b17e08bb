const NONE = 2;
const SHORTEST = 1e-12;

/**
 * The first zero on (0, 1] of a polynomial with these Bernstein coefficients, the first one positive, where a lens stops
 * growing; 2 if there is none.
 *
 * Where all are positive there is none, and where they change sign once there is one (Farouki and Rajan 1987;
 * Descartes). Other pieces are halved.
 */
export function firstZero(bernstein: number[]): number {
  return zeroWithin(bernstein, 0, 1) ?? NONE;
}

function zeroWithin(bernstein: number[], low: number, high: number): number | null {
  const negative = bernstein.findIndex((one) => one <= 0);
  if (negative < 0) return null;
  if (high - low < SHORTEST) return low;
  const middle = (low + high) / 2;
  const [left, right] = halves(bernstein);
  if (bernstein.slice(negative).some((one) => one > 0))
    return zeroWithin(left, low, middle) ?? zeroWithin(right, middle, high);
  return (right[0] ?? 0) > 0 ? zeroWithin(right, middle, high) : zeroWithin(left, low, middle);
}

/** De Casteljau: coefficients of both halves. */
function halves(bernstein: number[]): [number[], number[]] {
  const left: number[] = [];
  const right: number[] = [];
  for (let row = bernstein; row.length > 0; row = row.slice(1).map((one, i) => (one + (row[i] ?? 0)) / 2)) {
    left.push(row[0] ?? 0);
    right.unshift(row.at(-1) ?? 0);
  }
  return [left, right];
}
