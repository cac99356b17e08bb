/** A frame with the points that its camera sees, drawn into a canvas. */

import { css, palette } from "../points/colours.ts";
import type { Visible } from "./visible.ts";

/** Distances that the ends of the palette stand for, metres; what is between them goes by the logarithm. */
export interface Depths {
  low: number;
  high: number;
}

export const DEPTH_COLOURS = palette(true);
const SHADES = 64;

/** The distances between which nearly all points lie. */
export function depthsOf({ distance }: Visible): Depths | null {
  if (distance.length === 0) return null;
  const sorted = Float32Array.from(distance).sort();
  const at = (share: number): number => sorted[Math.round(share * (sorted.length - 1))] ?? 1;
  const low = Math.max(0.1, at(0.02));
  return { low, high: Math.max(at(0.98), 1.01 * low) };
}

/** Draws frame and points; without points the frame alone. */
export function draw(
  canvas: HTMLCanvasElement,
  image: HTMLImageElement,
  seen: Visible | null,
  depths: Depths | null,
): void {
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  const context = canvas.getContext("2d");
  if (!context) return;
  context.drawImage(image, 0, 0);
  if (!seen || !depths) return;
  const side = Math.max(2, Math.round(canvas.width / 480));
  const shades = Array.from({ length: SHADES }, (): number[] => []);
  for (let i = 0; i < seen.count; i += 1) shades[shadeOf(seen.distance[i] ?? 0, depths)]?.push(i);
  shades.forEach((members, shade) => {
    context.fillStyle = colourOf(shade / (SHADES - 1));
    for (const i of members) {
      // The centre of the first pixel is half a pixel inside of the canvas.
      context.fillRect((seen.u[i] ?? 0) + 0.5 - side / 2, (seen.v[i] ?? 0) + 0.5 - side / 2, side, side);
    }
  });
}

function shadeOf(distance: number, { low, high }: Depths): number {
  const share = Math.log(distance / low) / Math.log(high / low);
  return Math.round((SHADES - 1) * Math.min(1, Math.max(0, share)));
}

function colourOf(share: number): string {
  const place = share * (DEPTH_COLOURS.length - 1);
  const stop = Math.min(DEPTH_COLOURS.length - 2, Math.floor(place));
  const [from, to] = [DEPTH_COLOURS[stop], DEPTH_COLOURS[stop + 1]];
  if (!from || !to) return "#fff";
  const mixed = from.map((one, i) => one + ((to[i] ?? one) - one) * (place - stop));
  return css([mixed[0] ?? 0, mixed[1] ?? 0, mixed[2] ?? 0]);
}
