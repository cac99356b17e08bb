/** Where a camera sees points of the LiDAR: as `workers/geometry` says it, held to it by projection_vectors.json. */

import type { Rotation } from "../api/types.ts";
import { matrixOf, type Matrix } from "../transforms.ts";
import { firstZero } from "./fold.ts";

/** T_camera_lidar: the rows of its rotation, and metres. */
export interface Mount {
  rotation: Matrix;
  translation: readonly [number, number, number];
}

export interface Intrinsics {
  model: string;
  f_x: number;
  f_y: number;
  c_x: number;
  c_y: number;
  skew?: number | null;
  k1?: number | null;
  k2?: number | null;
  k3?: number | null;
  k4?: number | null;
  k5?: number | null;
  k6?: number | null;
  p1?: number | null;
  p2?: number | null;
}

/** Puts u and v of a point of the camera's frame into `pixel`, in pixels. False: no good projection exists. */
export type Project = (x: number, y: number, z: number, pixel: { u: number; v: number }) => boolean;

const TERMS = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"] as const;
/** Points less than this in front of the camera's plane count as behind it. */
const NEAREST_DEPTH_M = 1e-3;

export function mountOf(transform: { rotation: Rotation; translation_m: number[] }): Mount {
  const [x = 0, y = 0, z = 0] = transform.translation_m;
  return { rotation: matrixOf(transform.rotation), translation: [x, y, z] };
}

/** The projection of a lens. Throws an Error for a model that this page does not know. */
export function projectionOf(lens: Intrinsics): Project {
  const { k1, k2, k3, k4, k5, k6, p1, p2 } = termsOf(lens);
  if (lens.model === "pinhole") return divided(lens, [0, 0, 0], [0, 0, 0], 0, 0);
  if (lens.model === "brown_conrady") return divided(lens, [k1, k2, k5], [0, 0, 0], k3, k4);
  if (lens.model === "rational_polynomial") return divided(lens, [k1, k2, k3], [k4, k5, k6], p1, p2);
  if (lens.model === "kannala_brandt") return equidistant(lens);
  throw new Error(`This page knows no camera model ${lens.model}. Reload the page.`);
}

/** The terms of a lens; those that it does not state are 0. */
function termsOf(lens: Intrinsics): Record<(typeof TERMS)[number], number> {
  return Object.fromEntries(TERMS.map((name) => [name, lens[name] ?? 0])) as ReturnType<typeof termsOf>;
}

type Three = readonly [number, number, number];

/** x / z and y / z, times a quotient of radial polynomials, and tangential terms: the paper's eq. 3 and 4, and OpenCV's. */
function divided({ f_x, f_y, c_x, c_y, skew }: Intrinsics, n: Three, m: Three, p1: number, p2: number): Project {
  const fold = foldOfDivided(n, m);
  return (x, y, z, pixel) => {
    if (z < NEAREST_DEPTH_M) return false;
    const a = x / z;
    const b = y / z;
    const r2 = a * a + b * b;
    if (r2 > fold) return false;
    const radial = cubic(n, r2) / cubic(m, r2);
    const bentA = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a);
    const bentB = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b;
    pixel.u = f_x * (bentA + (skew ?? 0) * bentB) + c_x;
    pixel.v = f_y * bentB + c_y;
    return true;
  };
}

function cubic([k1, k2, k3]: Three, s: number): number {
  return 1 + s * (k1 + s * (k2 + s * k3));
}

/** r^2 at which r n(r^2) / m(r^2) stops growing or m is no longer positive. */
function foldOfDivided(n: Three, m: Three): number {
  if (n.every((one) => one >= 0) && m.every((one) => one === 0)) return Infinity;
  // r^2 = x / (1 - x) maps all radii onto (0, 1); times (1 - x)^6 the derivative has these Bernstein coefficients.
  const above = [1, ...n];
  const below = [1, ...m];
  const growth = [0, 1, 2, 3, 4, 5, 6].map((order) =>
    above.reduce((sum, one, i) => sum + (1 + 2 * (2 * i - order)) * one * (below[order - i] ?? 0), 0),
  );
  const whole = growth.map((one, order) => one / ([1, 6, 15, 20, 15, 6, 1][order] ?? 1));
  const x = Math.min(firstZero(whole), firstZero([1, m[0] / 3, m[1] / 3, m[2]]));
  return x < 1 ? x / (1 - x) : Infinity;
}

/** theta (1 + k1 theta^2 + ... + k4 theta^8): it sees beyond 90 degrees. */
function equidistant(lens: Intrinsics): Project {
  const { f_x, f_y, c_x, c_y } = lens;
  const { k1, k2, k3, k4 } = termsOf(lens);
  // As theta^2 = pi^2 x; the powers 1, x, x^2, x^3, x^4 in Bernstein's basis.
  const S = Math.PI ** 2;
  const [a, b, c, d] = [3 * k1 * S, 5 * k2 * S ** 2, 7 * k3 * S ** 3, 9 * k4 * S ** 4];
  const growth = [1, 1 + a / 4, 1 + a / 2 + b / 6, 1 + (3 * a) / 4 + b / 2 + c / 4, 1 + a + b + c + d];
  const fold = Math.PI * Math.sqrt(Math.min(1, firstZero(growth)));
  return (x, y, z, pixel) => {
    const r = Math.sqrt(x * x + y * y);
    const theta = Math.atan2(r, z);
    if (theta > fold) return false;
    const t2 = theta * theta;
    const bent = theta + theta * (t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    const scale = bent / Math.max(r, 1e-12);
    pixel.u = f_x * (x * scale) + c_x;
    pixel.v = f_y * (y * scale) + c_y;
    return true;
  };
}
