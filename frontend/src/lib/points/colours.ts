/** Colours of points: for each a number between 0 and 1, and the palette from 0 to 1. */

import type { Cloud } from "./cloud.ts";

export const COLOURINGS = ["height", "range", "intensity", "ring"] as const;
export type Colouring = (typeof COLOURINGS)[number];

export interface Shades {
  values: Float32Array;
  /** What 0 and 1 mean, in `unit`. */
  low: number;
  high: number;
  unit: string;
}

const SAMPLE = 20_000;

export function shadesOf(cloud: Cloud, by: Colouring): Shades {
  if (by === "ring") return scaled(cloud.rings, 0, Math.max(1, cloud.ringCount - 1), "");
  const values = by === "intensity" ? cloud.intensities : by === "range" ? rangesOf(cloud) : heightsOf(cloud);
  // A few points far out, or a few bright ones from a mirror, must not leave all others one colour.
  const sorted = values.slice(0, SAMPLE).sort();
  const at = (share: number): number => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
  const low = by === "height" ? at(0.02) : 0;
  return scaled(values, low, Math.max(at(0.98), low + 1e-6), by === "intensity" ? "" : "m");
}

function rangesOf({ count, positions }: Cloud): Float32Array {
  const ranges = new Float32Array(count);
  for (let i = 0; i < count; i += 1) {
    ranges[i] = Math.hypot(positions[3 * i] ?? 0, positions[3 * i + 1] ?? 0, positions[3 * i + 2] ?? 0);
  }
  return ranges;
}

function heightsOf({ count, positions }: Cloud): Float32Array {
  const heights = new Float32Array(count);
  for (let i = 0; i < count; i += 1) heights[i] = positions[3 * i + 2] ?? 0;
  return heights;
}

function scaled(given: Float32Array | Uint16Array, low: number, high: number, unit: string): Shades {
  const values = new Float32Array(given.length);
  const slope = 1 / (high - low);
  for (let i = 0; i < given.length; i += 1) values[i] = Math.min(1, Math.max(0, ((given[i] ?? 0) - low) * slope));
  return { values, low, high, unit };
}

export type Colour = [number, number, number];
export const STOPS = 9;

/** Green's cubehelix (2011), light enough to be seen on the background: red, green, blue from 0 to 1. */
export function palette(dark: boolean): Colour[] {
  const [from, to] = dark ? [0.42, 0.92] : [0.12, 0.62];
  return Array.from({ length: STOPS }, (_, i) => {
    const share = i / (STOPS - 1);
    const light = from + (to - from) * share;
    const angle = 2 * Math.PI * (1 - 0.55 * share); // from blue over green to orange
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const amplitude = (1.3 * light * (1 - light)) / 2;
    return [
      clamped(light + amplitude * (-0.14861 * cos + 1.78277 * sin)),
      clamped(light + amplitude * (-0.29227 * cos - 0.90649 * sin)),
      clamped(light + amplitude * 1.97294 * cos),
    ];
  });
}

const clamped = (value: number): number => Math.min(1, Math.max(0, value));

export function css([red, green, blue]: Colour): string {
  return `rgb(${[red, green, blue].map((part) => Math.round(255 * part)).join(" ")})`;
}
