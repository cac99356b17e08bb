/** The corners of the board, as the LiDAR sees it: their names in words and their places in a small drawing. */

import type { VertexSummary } from "./api/schema.ts";

export type Corner = VertexSummary["corner"] & string;

/** In the service's order. */
export const CORNERS: readonly Corner[] = ["top", "left", "right", "bottom"];

/** Clockwise. */
const AROUND: readonly Corner[] = ["top", "right", "bottom", "left"];
const TURNED = ["top corner", "right corner", "bottom corner", "left corner"];
const LEVEL = ["upper left corner", "upper right corner", "lower right corner", "lower left corner"];

/** Which corner of a board with level edges is `top`: 1 the upper left one, -1 the upper right one; 0: a corner is up. */
export const upperCorner = (options: Record<string, unknown> | undefined): number => Number(options?.upper_corner ?? 0);

/** Which corner it is, clockwise from the tip or from the upper left. */
const turns = (corner: Corner, upper: number): number => (AROUND.indexOf(corner) + Number(upper < 0)) % 4;

export const cornerWords = (corner: Corner | undefined, upper = 0): string =>
  (upper ? LEVEL : TURNED)[turns(corner ?? "top", upper)] ?? "";

/** Where a corner lies in a drawing that reaches from -1 to 1, y down. */
export function cornerPlace(corner: Corner, upper = 0): readonly [number, number] {
  const angle = (Math.PI / 4) * (2 * turns(corner, upper) - (upper ? 1 : 0));
  return [Math.sin(angle), -Math.cos(angle)];
}
