/** Which points a region keeps, by the rules of `workers/vertices/region.py`; a test compares both. */

import { dot, levelRows } from "./level_axes.ts";
import type { Operator, Quantity } from "./api/types.ts";
import { cornersOf, type Box, type Part, type Polygon, type Region } from "./region.ts";

type Test = (x: number, y: number, z: number) => boolean;
type Measure = (x: number, y: number, z: number) => number;

const DEGREES = 180 / Math.PI;

const QUANTITIES: Record<Quantity, Measure> = {
  x: (x) => x,
  y: (_, y) => y,
  z: (_, __, z) => z,
  range: (x, y, z) => Math.sqrt(x * x + y * y + z * z),
  azimuth_deg: (x, y) => Math.atan2(y, x) * DEGREES,
  elevation_deg: (x, y, z) => Math.atan2(z, Math.sqrt(x * x + y * y)) * DEGREES,
};

const OPERATORS: Record<Operator, (value: number, limit: number) => boolean> = {
  "<": (value, limit) => value < limit,
  "<=": (value, limit) => value <= limit,
  ">": (value, limit) => value > limit,
  ">=": (value, limit) => value >= limit,
};

/** 1 for each point (x, y, z each, metres) that lies inside, 0 for others. */
export function maskOf({ all, none = [], up }: Region, positions: Float32Array): Uint8Array {
  const [held, cut] = [all.map(testOf), none.map(testOf)];
  const within: Test = (x, y, z) => held.every((test) => test(x, y, z)) && !cut.some((test) => test(x, y, z));
  const rows = up && levelRows(up);
  const test: Test = rows
    ? (x, y, z) => within(dot(rows[0], [x, y, z]), dot(rows[1], [x, y, z]), dot(rows[2], [x, y, z]))
    : within;
  const kept = new Uint8Array(positions.length / 3);
  for (let i = 0; i < kept.length; i += 1) {
    kept[i] = test(positions[3 * i] ?? 0, positions[3 * i + 1] ?? 0, positions[3 * i + 2] ?? 0) ? 1 : 0;
  }
  return kept;
}

function testOf(part: Part): Test {
  if ("box" in part) return boxTest(part.box);
  if ("polygon" in part) return polygonTest(part.polygon, part.z);
  const measure = QUANTITIES[part.quantity];
  const compare = OPERATORS[part.op];
  const limit = part.value;
  if (!part.divided_by) return (x, y, z) => compare(measure(x, y, z), limit);
  const divisor = QUANTITIES[part.divided_by];
  return (x, y, z) => compare(measure(x, y, z) / divisor(x, y, z), limit);
}

function boxTest(box: Box["box"]): Test {
  const { min, max } = box;
  if (box.yaw_deg) return polygonTest(cornersOf(box), [min[2], max[2]]);
  return (x, y, z) => x >= min[0] && x <= max[0] && y >= min[1] && y <= max[1] && z >= min[2] && z <= max[2];
}

function polygonTest(corners: Polygon["polygon"], heights?: [number, number]): Test {
  const across = corners.map(([x]) => x);
  const along = corners.map(([, y]) => y);
  const [left, right] = [Math.min(...across), Math.max(...across)];
  const [low, high] = [Math.min(...along), Math.max(...along)];
  const [bottom, top] = heights ?? [-Infinity, Infinity];
  return (x, y, z) =>
    z >= bottom && z <= top && x >= left && x <= right && y >= low && y <= high && isWithin(x, y, corners);
}

/** Even-odd rule: does a ray to the right of (x, y) cross an odd number of sides? */
function isWithin(x: number, y: number, corners: Polygon["polygon"]): boolean {
  let inside = false;
  let before = corners.at(-1);
  for (const here of corners) {
    if (before && before[1] > y !== here[1] > y) {
      if (x < before[0] + ((here[0] - before[0]) * (y - before[1])) / (here[1] - before[1])) inside = !inside;
    }
    before = here;
  }
  return inside;
}
