import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { firstZero } from "./fold.ts";
import { mountOf, projectionOf, type Intrinsics } from "./projection.ts";

interface Case {
  intrinsics: Intrinsics;
  transform: Parameters<typeof mountOf>[0];
  points_lidar: [number, number, number][];
  pixels: ([number, number] | null)[];
}

const VECTORS = "../../../../tests/workers/geometry/projection_vectors.json";
const text = readFileSync(new URL(VECTORS, import.meta.url), "utf8");
const { cases } = JSON.parse(text) as { cases: Case[] };

/** As the paper counts them: 1e-6 px, beside which pixels of a thousand have 1e-13 of rounding. */
const SAME_PX = 1e-6;

test("the pages project as workers/geometry does", () => {
  assert.deepEqual([...new Set(cases.map((one) => one.intrinsics.model))].sort(), [
    "brown_conrady",
    "kannala_brandt",
    "pinhole",
    "rational_polynomial",
  ]);
  for (const { intrinsics, transform, points_lidar, pixels } of cases) {
    const project = projectionOf(intrinsics);
    const { rotation, translation } = mountOf(transform);
    const pixel = { u: NaN, v: NaN };
    points_lidar.forEach((point, i) => {
      const at = rotation.map((row, axis) =>
        row.reduce((sum, one, j) => sum + one * (point[j] ?? 0), translation[axis] ?? 0),
      );
      const seen = project(at[0] ?? 0, at[1] ?? 0, at[2] ?? 0, pixel);
      const wanted = pixels[i] ?? null;
      const where = `${intrinsics.model} ${JSON.stringify(point)}`;
      assert.equal(seen, wanted !== null, where);
      if (!wanted) return;
      assert.ok(Math.hypot(pixel.u - wanted[0], pixel.v - wanted[1]) < SAME_PX, where);
    });
  }
});

test("a fold that is undone close behind is seen", () => {
  const [at, apart] = [0.4, 1e-5]; // (x - at)^2 - apart^2, scaled to 1 at zero
  const free = at * at - apart * apart;
  assert.ok(Math.abs(firstZero([1, 1 - at / free, 1 - (2 * at) / free + 1 / free]) - (at - apart)) < 1e-9);
  const never = at * at + 1e-9;
  assert.equal(firstZero([1, 1 - at / never, 1 - (2 * at) / never + 1 / never]), 2);
  assert.equal(firstZero([1, 2, 3, 4, 5]), 2);
});

test("an unknown model is said", () => {
  assert.throws(() => projectionOf({ model: "mirror", f_x: 1, f_y: 1, c_x: 0, c_y: 0 }), /mirror/);
});
