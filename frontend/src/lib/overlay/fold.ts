/**
 * The first zero of 1 + p1 x + ... + p4 x^4 on (0, 1], where a lens polynomial stops growing; 2 if there is none.
 *
 * Bernstein coefficients isolate it: where all are positive there is none, and where they change sign once there is one
 * (Farouki and Rajan 1987; Descartes). Other pieces are halved.
 */
export function firstZero(p1: number, p2: number, p3: number, p4: number): number {
  const value = (x: number): number => 1 + x * (p1 + x * (p2 + x * (p3 + x * p4)));
  const whole = [1, 1 + p1 / 4, 1 + p1 / 2 + p2 / 6, 1 + (3 * p1) / 4 + p2 / 2 + p3 / 4, value(1)];
  return zeroWithin(value, whole, 0, 1) ?? NONE;
}

const NONE = 2;
const SHORTEST = 1e-12;

function zeroWithin(value: (x: number) => number, bernstein: number[], low: number, high: number): number | null {
  const rest = bernstein.slice(1);
  if (rest.every((one) => one > 0)) return null;
  const negative = rest.findIndex((one) => one <= 0);
  if (rest.slice(negative).every((one) => one <= 0)) return bisected(value, low, high);
  if (high - low < SHORTEST) return low;
  const middle = (low + high) / 2;
  const [left, right] = halves(bernstein);
  return zeroWithin(value, left, low, middle) ?? zeroWithin(value, right, middle, high);
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

function bisected(value: (x: number) => number, low: number, high: number): number {
  for (;;) {
    const middle = (low + high) / 2;
    if (middle <= low || middle >= high) return middle;
    if (value(middle) > 0) low = middle;
    else high = middle;
  }
}
