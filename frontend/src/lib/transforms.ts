/** Rotations of transform documents, shown to people as Euler angles R = Rz(alpha) Ry(beta) Rx(gamma). */

import type { Rotation } from "./api/types.ts";

type Vector = [number, number, number];
/** Three rows. */
export type Matrix = [Vector, Vector, Vector];

const RAD = Math.PI / 180;

export function product(a: Matrix, b: Matrix): Matrix {
  const of = ([x, y, z]: Vector, j: 0 | 1 | 2): number => x * b[0][j] + y * b[1][j] + z * b[2][j];
  const times = (row: Vector): Vector => [of(row, 0), of(row, 1), of(row, 2)];
  return [times(a[0]), times(a[1]), times(a[2])];
}

function about(axis: 0 | 1 | 2, degrees: number): Matrix {
  const [c, s] = [Math.cos(degrees * RAD), Math.sin(degrees * RAD)];
  const part = (row: number, column: number): number => {
    if (row === axis || column === axis) return row === column ? 1 : 0;
    return row === column ? c : row === (axis + 1) % 3 ? -s : s;
  };
  return [0, 1, 2].map((row) => [0, 1, 2].map((column) => part(row, column))) as Matrix;
}

function ofQuaternion([x, y, z, w]: [number, number, number, number]): Matrix {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

/** The 3 x 3 matrix of a rotation document. */
export function matrixOf(rotation: Rotation): Matrix {
  if ("matrix" in rotation) return rotation.matrix as Matrix;
  if ("quaternion_xyzw" in rotation) return ofQuaternion(rotation.quaternion_xyzw);
  const [alpha, beta, gamma] = rotation.angles_deg;
  if (rotation.euler_order === "xyz_eq2") return product(product(about(0, alpha), about(1, beta)), about(2, gamma));
  return product(product(about(2, alpha), about(1, beta)), about(0, gamma));
}

/**
 * (alpha, beta, gamma) in degrees. Of the two triples that every rotation has, the one whose absolute values sum to
 * less, as the service gives it: a camera tilted 15 degrees down reads (90, -105, 0). At beta = +-90 only
 * alpha -+ gamma is determined; gamma is 0 there.
 */
export function eulerZyx(rotation: Rotation): Vector {
  const m = matrixOf(rotation);
  const beta = Math.asin(Math.max(-1, Math.min(1, -m[2][0])));
  if (Math.hypot(m[0][0], m[1][0]) < 1e-9) {
    return [Math.atan2(-m[0][1], m[1][1]) / RAD, beta / RAD, 0];
  }
  const first: Vector = [Math.atan2(m[1][0], m[0][0]) / RAD, beta / RAD, Math.atan2(m[2][1], m[2][2]) / RAD];
  const second: Vector = [wrapped(first[0] + 180), wrapped(180 - first[1]), wrapped(first[2] + 180)];
  return size(second) < size(first) - 1e-7 ? second : first;
}

const wrapped = (degrees: number): number => (degrees > 180 ? degrees - 360 : degrees);
const size = (angles: Vector): number => angles.reduce((sum, angle) => sum + Math.abs(angle), 0);
