/** Views of points: places of a camera that shows an extent. Metres; x forward, y left, z up. */

import type { Extent } from "./cloud.ts";

export const VIEWS = ["orbit", "top", "front", "side", "sensor"] as const;
export type ViewName = (typeof VIEWS)[number];

export type Vector = [number, number, number];

export interface Place {
  /** A flat view keeps lengths (no vanishing point), and is moved, not turned. */
  flat: boolean;
  position: Vector;
  target: Vector;
  /** Of a flat view: half of what is seen from bottom to top. */
  halfHeight: number;
}

// The LiDAR itself: the camera turns about a point this far ahead of it.
const EYE_M = 0.01;
const MARGIN = 1.08;
// So little off straight above that nobody sees it, but enough that up stays defined.
const TILT = 1e-4;

/** Where the camera stands to show an extent in a window that is `aspect` times as wide as high. */
export function placeOf(name: ViewName, { min, max }: Extent, aspect: number): Place {
  const middle = [0, 1, 2].map((axis) => ((min[axis] ?? 0) + (max[axis] ?? 0)) / 2) as Vector;
  const size = [0, 1, 2].map((axis) => Math.max(0.5, (max[axis] ?? 0) - (min[axis] ?? 0))) as Vector;
  const far = 2 * Math.hypot(...size) + 10;
  const flat = (across: number, up: number, position: Vector): Place => ({
    flat: true,
    position,
    target: middle,
    halfHeight: (MARGIN * Math.max(up, across / aspect)) / 2,
  });
  const [x, y, z] = middle;
  switch (name) {
    case "top":
      return flat(size[0], size[1], [x, y - TILT * far, z + far]);
    case "front": // as the LiDAR looks: y to the left
      return flat(size[1], size[2], [x - far, y, z]);
    case "side": // from the right: x to the right
      return flat(size[0], size[2], [x, y - far, z]);
    case "sensor":
      return { flat: false, position: [-EYE_M, 0, 0], target: [0, 0, 0], halfHeight: 0 };
    default: {
      const away = 0.62 * Math.hypot(size[0], size[1]);
      return {
        flat: false,
        position: [x - 0.85 * away, y - 0.35 * away, z + 0.55 * away],
        target: middle,
        halfHeight: 0,
      };
    }
  }
}

/** Distances for circles about the LiDAR: round, at most five, the largest within `reach`. */
export function circlesOf(reach: number): number[] {
  const step = [1, 2, 5, 10, 20, 50, 100].find((each) => reach / each <= 5) ?? 200;
  return Array.from({ length: Math.floor(reach / step) }, (_, i) => (i + 1) * step);
}
