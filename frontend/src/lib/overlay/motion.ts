/**
 * Points of the board and its holder, moved to a frame's time along the corner's track. The vehicle stands.
 * vectors.json holds it to what NumPy computes of the same cases.
 */

import type { Sweep } from "../points/sweep.ts";

interface Moment {
  time_ns: number;
  x: number;
  y: number;
  z: number;
}

type Vector = [number, number, number];

/** The board's corner at a moment, metres and metres a second. */
export interface Motion {
  atNs: number;
  corner: Vector;
  velocity: Vector;
}

/** Between vertices farther apart a walker may have turned round. */
const LONGEST_NS = 1.5e9;
/** So far a board of 60 x 90 cm reaches to the side of its corner, and so far down. */
const BESIDE_M = 0.55;
const BELOW_M = 1.1;
const ABOVE_M = 0.1;

/** How the corner moves at a moment, by the vertices before and after it; null where the track is open. */
export function motionAt(vertices: readonly Moment[], atNs: number): Motion | null {
  let before: Moment | null = null;
  let after: Moment | null = null;
  for (const one of vertices) {
    if (one.time_ns <= atNs && one.time_ns > (before?.time_ns ?? -Infinity)) before = one;
    if (one.time_ns > atNs && one.time_ns < (after?.time_ns ?? Infinity)) after = one;
  }
  if (!before || !after || after.time_ns - before.time_ns > LONGEST_NS) return null;
  const seconds = (after.time_ns - before.time_ns) / 1e9;
  const since = (atNs - before.time_ns) / 1e9;
  const from: Vector = [before.x, before.y, before.z];
  const to: Vector = [after.x, after.y, after.z];
  const velocity = from.map((one, axis) => ((to[axis] ?? one) - one) / seconds) as Vector;
  return { atNs, velocity, corner: from.map((one, axis) => one + since * (velocity[axis] ?? 0)) as Vector };
}

export interface Moved {
  sweep: Sweep;
  /** How many points were moved, and the farthest of them. */
  count: number;
  farthestM: number;
}

/** The sweep of this stamp with the points of board and holder where they were at the motion's moment. */
export function moved(sweep: Sweep, stampNs: number, { atNs, corner, velocity }: Motion): Moved {
  const positions = sweep.positions.slice();
  const speed = Math.hypot(...velocity);
  let [count, farthestM] = [0, 0];
  for (let i = 0; i < sweep.count; i += 1) {
    const later = (atNs - stampNs - (sweep.timesNs[i] ?? 0)) / 1e9;
    const there = [0, 1, 2].map((axis) => (positions[3 * i + axis] ?? 0) + later * (velocity[axis] ?? 0)) as Vector;
    const above = there[2] - corner[2];
    if (above > ABOVE_M || above < -BELOW_M) continue;
    if (Math.hypot(there[0] - corner[0], there[1] - corner[1]) > BESIDE_M) continue;
    positions.set(there, 3 * i);
    count += 1;
    farthestM = Math.max(farthestM, Math.abs(later) * speed);
  }
  return { sweep: { ...sweep, positions }, count, farthestM };
}
