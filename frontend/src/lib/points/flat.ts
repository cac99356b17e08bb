/** Pixels and metres of a flat picture, which shows two of x, y and z and keeps lengths. */

import { AXES, type Plane, type Spot } from "../drawing.ts";
import { toScreen } from "./picking.ts";
import type { Seen } from "./scene.ts";

interface Place {
  x: number;
  y: number;
}

/** Where a spot is in the picture. */
export function pixelsOf({ matrix, width, height }: Seen, plane: Plane, spot: Spot): Place {
  const point: [number, number, number] = [0, 0, 0];
  AXES[plane].forEach((axis, i) => (point[axis] = spot[i] ?? 0));
  return toScreen(matrix, width, height, point) ?? { x: NaN, y: NaN };
}

/** The spot at a place in the picture. */
export function metresAt(seen: Seen, plane: Plane, at: Place): Spot {
  const [from, right, up] = [
    pixelsOf(seen, plane, [0, 0]),
    pixelsOf(seen, plane, [1, 0]),
    pixelsOf(seen, plane, [0, 1]),
  ];
  const [ax, ay, bx, by] = [right.x - from.x, right.y - from.y, up.x - from.x, up.y - from.y];
  const determinant = ax * by - bx * ay;
  const [dx, dy] = [at.x - from.x, at.y - from.y];
  return [(dx * by - dy * bx) / determinant, (dy * ax - dx * ay) / determinant];
}
