/** The shapes of a region seen from above, for drawing: metres, x forward, y left. */

import type { Box, Region } from "./region.ts";

export type Corner = [number, number];

/** Outlines of all boxes and polygons of a region, wherever they stand in it. */
export function outlinesOf(region: Region): Corner[][] {
  if ("and" in region) return region.and.flatMap(outlinesOf);
  if ("or" in region) return region.or.flatMap(outlinesOf);
  if ("not" in region) return outlinesOf(region.not);
  if ("box" in region) return [cornersOf(region.box)];
  return "polygon" in region ? [region.polygon] : [];
}

/** A box's four corners, turned about its middle. */
export function cornersOf({ min, max, yaw_deg = 0 }: Box["box"]): Corner[] {
  const [x, y] = [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2];
  const [dx, dy] = [(max[0] - min[0]) / 2, (max[1] - min[1]) / 2];
  const yaw = (yaw_deg * Math.PI) / 180;
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const signs: Corner[] = [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ];
  return signs.map(([i, j]) => [x + i * dx * cos - j * dy * sin, y + i * dx * sin + j * dy * cos]);
}
