import assert from "node:assert/strict";
import { test } from "node:test";
import type { Sweep } from "../points/sweep.ts";
import { motionAt, moved } from "./motion.ts";

const STAMP = 1_700_000_000e9;
const at = (ms: number): number => STAMP + ms * 1e6;
/** A corner that goes 1.2 m/s to the left and 0.5 m/s away. */
const corner = (ms: number): [number, number, number] => [8 + 0.0005 * ms, -1 + 0.0012 * ms, 0.5];
const vertices = [-60, 40, 140, 5000].map((ms) => {
  const [x, y, z] = corner(ms);
  return { time_ns: at(ms), x, y, z };
});

/** Points that were measured one after the other: on the board as it moves, on a wall behind it, on the ground. */
function sweepOf(): Sweep {
  const points: number[] = [];
  const times: number[] = [];
  for (let i = 0; i < 100; i += 1) {
    const [x, y, z] = corner(i);
    points.push(x, y + 0.3 * Math.sin(i), z - 0.9 * Math.abs(Math.cos(i)));
    points.push(12, -1 + 0.01 * i, 0.2);
    points.push(8, -1 + 0.01 * i, -1.7);
    times.push(i * 1e6, i * 1e6, i * 1e6);
  }
  const count = times.length;
  return {
    count,
    ringCount: 1,
    positions: Float32Array.from(points),
    rings: new Uint16Array(count),
    intensities: new Float32Array(count),
    timesNs: Float64Array.from(times),
  };
}

test("the board's points are where it was at the frame's time, and nothing else moves", () => {
  const sweep = sweepOf();
  const motion = motionAt(vertices, at(90));
  assert.ok(motion);
  assert.ok(Math.hypot(motion.velocity[0] - 0.5, motion.velocity[1] - 1.2, motion.velocity[2]) < 1e-3);
  const found = moved(sweep, STAMP, motion);
  assert.equal(found.count, 100);
  assert.ok(Math.abs(found.farthestM - 0.09 * 1.3) < 1e-3, `${found.farthestM}`);
  const [x, y, z] = corner(90);
  for (let i = 0; i < 100; i += 1) {
    const there = found.sweep.positions.subarray(9 * i, 9 * i + 3);
    const wanted = [x, y + 0.3 * Math.sin(i), z - 0.9 * Math.abs(Math.cos(i))];
    wanted.forEach((one, axis) => assert.ok(Math.abs((there[axis] ?? NaN) - one) < 1e-4));
    const others = [9 * i + 3, 9 * i + 9] as const;
    assert.deepEqual(found.sweep.positions.subarray(...others), sweep.positions.subarray(...others));
  }
});

test("where the track is open nothing is known of the motion", () => {
  assert.equal(motionAt(vertices, at(1000)), null);
  assert.equal(motionAt(vertices, at(-100)), null);
  assert.equal(motionAt([], at(0)), null);
});
