/** Level axes of a tilted LiDAR, by the rule of `workers/vertices/sensor_grid.py`. */

import type { Cloud } from "./points/cloud.ts";
import type { Point } from "./region.ts";

/** Rows of the rotation to axes whose z is up and whose x is the horizontal direction nearest to the LiDAR's x. */
export function levelRows(up: Point): [Point, Point, Point] {
  const z = unit(up);
  const ahead: Point = Math.abs(z[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const along = dot(z, ahead);
  const x = unit([ahead[0] - along * z[0], ahead[1] - along * z[1], ahead[2] - along * z[2]]);
  return [x, [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]], z];
}

/** The points in level axes. */
export function levelled(cloud: Cloud, up: Point): Cloud {
  const rows = levelRows(up);
  const positions = new Float32Array(cloud.positions.length);
  for (let i = 0; i < positions.length; i += 3) {
    const at: Point = [cloud.positions[i] ?? 0, cloud.positions[i + 1] ?? 0, cloud.positions[i + 2] ?? 0];
    positions.set(
      rows.map((row) => dot(row, at)),
      i,
    );
  }
  return { ...cloud, positions };
}

export function dot(a: Point, b: Point): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function unit(vector: Point): Point {
  const length = Math.sqrt(dot(vector, vector));
  return [vector[0] / length, vector[1] / length, vector[2] / length];
}
