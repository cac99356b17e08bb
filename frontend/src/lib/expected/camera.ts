/** A camera of eleven parameters, each in standard deviations of its prior: a mount about the rig's, and a lens. */

import { projectionOf, type Mount } from "../overlay/projection.ts";
import type { Pixel, Size } from "../pixels.ts";
import { product, type Matrix } from "../transforms.ts";

/** A place in metres in the LiDAR's frame. */
export interface Place {
  x: number;
  y: number;
  z: number;
}

export type Sees = (place: Place) => Pixel | null;

export const PARAMETERS = 11;

/**
 * The priors are as wide as the intervals that the solver searches (docs/solver.md): 30 degrees and 1 m about the
 * nominal mount, coefficients from -1 to 1. This is the standard deviation of a uniform distribution from -1 to 1.
 */
const UNIFORM = 1 / Math.sqrt(3);
const ROTATION = (UNIFORM * 30 * Math.PI) / 180;
/** Focal lengths in widths of the image. */
const SHORTEST_WIDTHS = 0.2;
const LONGEST_WIDTHS = 3;

/**
 * What a camera sees. The lens is Kannala and Brandt's with two coefficients: with 1/3 and 2/15 it is a pinhole's to
 * 2 % at 45 degrees.
 */
export function cameraOf(at: Float64Array, nominal: Mount, { width, height }: Size): Sees {
  const of = (i: number): number => at[i] ?? 0;
  const [r0, r1, r2] = product(turn(ROTATION * of(0), ROTATION * of(1), ROTATION * of(2)), nominal.rotation);
  const [tx, ty, tz] = nominal.translation;
  const [low, high] = [Math.log(SHORTEST_WIDTHS), Math.log(LONGEST_WIDTHS)];
  const f = width * Math.exp((low + high + UNIFORM * (high - low) * of(6)) / 2);
  const project = projectionOf({
    model: "kannala_brandt",
    f_x: f,
    f_y: f,
    c_x: (width - 1) / 2 + (UNIFORM * width * of(7)) / 2,
    c_y: (height - 1) / 2 + (UNIFORM * height * of(8)) / 2,
    k1: UNIFORM * of(9),
    k2: UNIFORM * of(10),
  });
  return (place) => {
    const pixel = { u: 0, v: 0 };
    const along = (row: readonly [number, number, number], by: number): number =>
      row[0] * place.x + row[1] * place.y + row[2] * place.z + by;
    return project(
      along(r0, tx + UNIFORM * of(3)),
      along(r1, ty + UNIFORM * of(4)),
      along(r2, tz + UNIFORM * of(5)),
      pixel,
    )
      ? pixel
      : null;
  };
}

/** The rotation by a vector of radians: Rodrigues. */
function turn(x: number, y: number, z: number): Matrix {
  const angle = Math.hypot(x, y, z);
  const s = angle > 1e-9 ? Math.sin(angle) / angle : 1;
  const c = angle > 1e-9 ? (1 - Math.cos(angle)) / angle ** 2 : 0.5;
  return [
    [1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
    [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
    [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)],
  ];
}
