/** Points to be shown: those of one sweep or of several. */

import type { Sweep } from "./sweep.ts";

/** The first n points are an even sample of all, for every n. */
export interface Cloud extends Sweep {
  /** Which of `sweeps` each point is of. */
  sweepOf: Uint16Array;
  sweeps: { index: number }[];
}

/** Several sweeps, with their numbers in the recording, as one cloud. */
export function cloudOf(sweeps: readonly (Sweep & { index: number })[]): Cloud {
  const count = sweeps.reduce((sum, sweep) => sum + sweep.count, 0);
  const cloud: Cloud = {
    count,
    ringCount: Math.max(0, ...sweeps.map((sweep) => sweep.ringCount)),
    positions: new Float32Array(3 * count),
    rings: new Uint16Array(count),
    intensities: new Float32Array(count),
    timesNs: new Float64Array(count),
    sweepOf: new Uint16Array(count),
    sweeps: sweeps.map(({ index }) => ({ index })),
  };
  const firsts = sweeps.map((_, number) => sweeps.slice(0, number).reduce((sum, before) => sum + before.count, 0));
  const owner = new Uint16Array(count);
  firsts.forEach((first, number) => owner.fill(number, first));
  const step = spreadingStep(count);
  for (let to = 0, from = 0; to < count; to += 1, from = (from + step) % count) {
    const number = owner[from] ?? 0;
    const sweep = sweeps[number];
    if (!sweep) break;
    const i = from - (firsts[number] ?? 0);
    for (let axis = 0; axis < 3; axis += 1) cloud.positions[3 * to + axis] = sweep.positions[3 * i + axis] ?? 0;
    cloud.rings[to] = sweep.rings[i] ?? 0;
    cloud.intensities[to] = sweep.intensities[i] ?? 0;
    cloud.timesNs[to] = sweep.timesNs[i] ?? 0;
    cloud.sweepOf[to] = number;
  }
  return cloud;
}

/**
 * Steps of this size visit all of `count` points. Any number of steps in a row spread evenly over all rings and
 * azimuths, because points are ordered by these.
 */
function spreadingStep(count: number): number {
  let step = Math.max(1, Math.round(count * 0.6180339887)); // the golden section
  while (count > 1 && divisor(step, count) > 1) step += 1;
  return step;
}

function divisor(a: number, b: number): number {
  return b === 0 ? a : divisor(b, a % b);
}

/** What is known of one point. */
export function factsOf(cloud: Cloud, i: number) {
  const [x = 0, y = 0, z = 0] = cloud.positions.subarray(3 * i, 3 * i + 3);
  return {
    x,
    y,
    z,
    range: Math.hypot(x, y, z),
    azimuthDeg: (Math.atan2(y, x) * 180) / Math.PI,
    elevationDeg: (Math.atan2(z, Math.hypot(x, y)) * 180) / Math.PI,
    ring: cloud.rings[i] ?? 0,
    intensity: cloud.intensities[i] ?? 0,
    timeNs: cloud.timesNs[i] ?? 0,
    sweep: cloud.sweeps[cloud.sweepOf[i] ?? 0]?.index ?? 0,
  };
}

export interface Extent {
  min: [number, number, number];
  max: [number, number, number];
}

/** The extent of most points (nine tenths of a sample along each axis) and the LiDAR. */
export function extentOf(cloud: Cloud): Extent {
  const sample = Math.min(cloud.count, 10_000);
  const extent: Extent = { min: [0, 0, 0], max: [0, 0, 0] };
  for (const axis of [0, 1, 2] as const) {
    const values = Float32Array.from({ length: sample }, (_, i) => cloud.positions[3 * i + axis] ?? 0).sort();
    extent.min[axis] = Math.min(0, values[Math.floor(0.05 * (sample - 1))] ?? 0);
    extent.max[axis] = Math.max(0, values[Math.ceil(0.95 * (sample - 1))] ?? 0);
  }
  return extent;
}
