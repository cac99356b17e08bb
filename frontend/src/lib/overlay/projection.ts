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
}

/** Puts u and v of a point of the camera's frame into `pixel`, in pixels. False: no good projection exists. */
export type Project = (x: number, y: number, z: number, pixel: { u: number; v: number }) => boolean;

/** Points less than this in front of the camera's plane count as behind it. */
const NEAREST_DEPTH_M = 1e-3;

export function mountOf(transform: { rotation: Rotation; translation_m: number[] }): Mount {
  const [x = 0, y = 0, z = 0] = transform.translation_m;
  return { rotation: matrixOf(transform.rotation), translation: [x, y, z] };
}

/** The projection of a lens. Throws an Error for a model that this page does not know. */
export function projectionOf(lens: Intrinsics): Project {
  if (lens.model === "pinhole") return divided({ ...lens, skew: 0, k1: 0, k2: 0, k3: 0, k4: 0, k5: 0 });
  if (lens.model === "brown_conrady") return divided(lens);
  if (lens.model === "kannala_brandt") return equidistant(lens);
  throw new Error(`This page knows no camera model ${lens.model}. Reload the page.`);
}

/** x / z and y / z, bent by radial and tangential polynomials: the paper's eq. 3 and 4. */
function divided({ f_x, f_y, c_x, c_y, ...bends }: Intrinsics): Project {
  const [skew, k1, k2, k3, k4, k5] = [bends.skew, bends.k1, bends.k2, bends.k3, bends.k4, bends.k5].map(
    (one) => one ?? 0,
  ) as [number, number, number, number, number, number];
  const fold = foldOfDivided(k1, k2, k5);
  return (x, y, z, pixel) => {
    if (z < NEAREST_DEPTH_M) return false;
    const a = x / z;
    const b = y / z;
    const r2 = a * a + b * b;
    if (r2 > fold) return false;
    const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k5));
    const bentA = a * radial + 2 * k3 * a * b + k4 * (r2 + 2 * a * a);
    const bentB = b * radial + k3 * (r2 + 2 * b * b) + 2 * k4 * a * b;
    pixel.u = f_x * (bentA + skew * bentB) + c_x;
    pixel.v = f_y * bentB + c_y;
    return true;
  };
}

/** r^2 at which r (1 + k1 r^2 + k2 r^4 + k5 r^6) stops growing. */
function foldOfDivided(k1: number, k2: number, k5: number): number {
  if (k1 >= 0 && k2 >= 0 && k5 >= 0) return Infinity;
  // r^2 = x / (1 - x) maps all radii onto (0, 1); times (1 - x)^3 the derivative is this cubic.
  const [a, b, c] = [3 * k1, 5 * k2, 7 * k5];
  const x = firstZero(a - 3, 3 - 2 * a + b, a - b + c - 1, 0);
  return x < 1 ? x / (1 - x) : Infinity;
}

/** theta (1 + k1 theta^2 + ... + k4 theta^8): it sees beyond 90 degrees. */
function equidistant({ f_x, f_y, c_x, c_y, ...bends }: Intrinsics): Project {
  const [k1, k2, k3, k4] = [bends.k1, bends.k2, bends.k3, bends.k4].map((one) => one ?? 0) as [
    number,
    number,
    number,
    number,
  ];
  const S = Math.PI ** 2;
  const fold =
    Math.PI * Math.sqrt(Math.min(1, firstZero(3 * k1 * S, 5 * k2 * S ** 2, 7 * k3 * S ** 3, 9 * k4 * S ** 4)));
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
