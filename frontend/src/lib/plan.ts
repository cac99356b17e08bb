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

export interface Frame {
  left: number;
  top: number;
  width: number;
  height: number;
}

/** What to show, in the drawing's own axes (to the right: x, down: -y), so that the LiDAR and all outlines are in it. */
export function frameOf(outlines: readonly Corner[][]): Frame {
  const corners: Corner[] = [[0, 0], ...outlines.flat()];
  const across = corners.map(([x]) => x);
  const down = corners.map(([, y]) => -y);
  const margin = 1;
  const [left, top] = [Math.min(...across) - margin, Math.min(...down) - margin];
  return { left, top, width: Math.max(...across) + margin - left, height: Math.max(...down) + margin - top };
}

/** Distances ahead at which to draw a line: round ones, and not too many. */
export function ticksOf({ left, width }: Frame): number[] {
  const step = [1, 2, 5, 10, 20, 50, 100].find((each) => width / each <= 8) ?? 1000;
  const first = Math.ceil(left / step);
  const count = Math.floor((left + width) / step) - first + 1;
  return Array.from({ length: count }, (_, i) => (first + i) * step);
}
