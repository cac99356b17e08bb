/** The point that a place in the window means. */

/** A camera's 4 x 4 matrix from metres to clip coordinates, column by column. */
export type Matrix = readonly number[];

export interface Screen {
  x: number;
  y: number;
  /** Distance from the camera; nearer points hide others. */
  depth: number;
}

/** Where a point is in a window of this size; null behind the camera. */
export function toScreen(
  matrix: Matrix,
  width: number,
  height: number,
  [x, y, z]: readonly [number, number, number],
): Screen | null {
  const row = (r: number): number =>
    (matrix[r] ?? 0) * x + (matrix[r + 4] ?? 0) * y + (matrix[r + 8] ?? 0) * z + (matrix[r + 12] ?? 0);
  const w = row(3);
  const depth = row(2) / w;
  if (w <= 0 || depth < -1 || depth > 1) return null;
  return { x: ((row(0) / w + 1) * width) / 2, y: ((1 - row(1) / w) * height) / 2, depth };
}

/** How many pixels off a point may be to be meant by a pointer, and by keys, which ask about the middle. */
export const POINTER_PX = 12;
export const KEYS_PX = 200;

/** The point nearest to a place in the window; of points equally near in pixels, the front one. -1: none is near. */
export function pick(
  positions: Float32Array,
  matrix: Matrix,
  width: number,
  height: number,
  at: { x: number; y: number },
  reach = POINTER_PX,
): number {
  let best = -1;
  let least = Infinity;
  const point: [number, number, number] = [0, 0, 0];
  for (let i = 0; i < positions.length / 3; i += 1) {
    for (let axis = 0; axis < 3; axis += 1) point[axis] = positions[3 * i + axis] ?? 0;
    const seen = toScreen(matrix, width, height, point);
    if (!seen) continue;
    const away = Math.hypot(seen.x - at.x, seen.y - at.y);
    if (away > reach) continue;
    const score = Math.round(away) + seen.depth;
    if (score < least) [best, least] = [i, score];
  }
  return best;
}
