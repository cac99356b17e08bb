/** The corners of the board, as the LiDAR sees it: their names in words and their places in a small drawing. */

import type { VertexSummary } from "./api/schema.ts";

export type Corner = VertexSummary["corner"] & string;

/** In the service's order. */
export const CORNERS: readonly Corner[] = ["top", "left", "right", "bottom"];

const WORDS: Record<Corner, string> = {
  top: "top vertex",
  right: "right corner",
  left: "left corner",
  bottom: "bottom corner",
};

export const cornerWords = (corner: Corner | undefined): string => WORDS[corner ?? "top"];

/** Where a corner lies in a drawing that reaches from -1 to 1, y down. */
export const PLACES: Record<Corner, readonly [number, number]> = {
  top: [0, -1],
  right: [1, 0],
  left: [-1, 0],
  bottom: [0, 1],
};
