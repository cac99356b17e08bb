import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import type { Sweep } from "../points/sweep.ts";
import { motionAt, moved } from "./motion.ts";
import { mountOf, projectionOf, type Intrinsics } from "./projection.ts";
import { visibleOf } from "./visible.ts";

interface Vectors {
  size: [number, number];
  vertices: { time_ns: number; x: number; y: number; z: number }[];
  sweep: { stamp_ns: number; rings: number[]; points: [number, number, number][]; times_ns: number[] };
  cases: {
    intrinsics: Intrinsics;
    transform: Parameters<typeof mountOf>[0];
    at_ns: number;
    moved: { count: number; farthest_m: number } | null;
    pixels: [number, number][];
    distance_m: number[];
    hidden: number;
  }[];
}

// Computed by NumPy from the same cases, apart from these files.
const text = readFileSync(new URL("./vectors.json", import.meta.url), "utf8");
const { size, vertices, sweep: given, cases } = JSON.parse(text) as Vectors;

const sweep: Sweep = {
  count: given.rings.length,
  ringCount: Math.max(...given.rings) + 1,
  positions: Float32Array.from(given.points.flat()),
  rings: Uint16Array.from(given.rings),
  intensities: new Float32Array(given.rings.length),
  timesNs: Float64Array.from(given.times_ns),
};

test("the pages see and move the same points as NumPy, at the same places", () => {
  for (const one of cases) {
    const where = `${one.intrinsics.model} at ${one.at_ns}`;
    const motion = motionAt(vertices, one.at_ns);
    assert.equal(motion === null, one.moved === null, where);
    const atFrame = motion && moved(sweep, given.stamp_ns, motion);
    assert.equal(atFrame?.count, one.moved?.count, where);
    assert.ok(Math.abs((atFrame?.farthestM ?? 0) - (one.moved?.farthest_m ?? 0)) < 1e-9, where);
    const [width, height] = size;
    const project = projectionOf(one.intrinsics);
    const seen = visibleOf(atFrame?.sweep ?? sweep, mountOf(one.transform), project, { width, height });
    assert.equal(seen.count, one.pixels.length, where);
    assert.equal(seen.hidden, one.hidden, where);
    one.pixels.forEach(([u, v], i) => {
      assert.ok(Math.hypot((seen.u[i] ?? NaN) - u, (seen.v[i] ?? NaN) - v) < 1e-6, `${where}: point ${i}`);
      assert.ok(Math.abs((seen.distance[i] ?? NaN) - (one.distance_m[i] ?? NaN)) < 1e-4, `${where}: point ${i}`);
    });
  }
});
