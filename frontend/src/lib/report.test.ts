import assert from "node:assert/strict";
import { test } from "node:test";
import type { ResultView } from "./api/schema.ts";
import { columnsOf, coverageOf, residualsOf, ringsOf, type Residuals } from "./report.ts";

// The LiDAR looks along x, the camera along z: a quarter turn about each of two axes.
const result = {
  transform: { rotation: { quaternion_xyzw: [0.5, -0.5, 0.5, 0.5] }, translation_m: [0, 0, 0] },
  intrinsics: { model: "pinhole", f_x: 100, f_y: 100, c_x: 50, c_y: 40, image_size: [100, 80] },
} as unknown as ResultView;

test("a pair's residual is its mark minus its projection; behind the camera there is none", () => {
  const rows = [
    { x: 10, y: 1, z: 0, u: 43, v: 44, stamp_ns: 5 },
    { x: -10, y: 1, z: 0, u: 43, v: 44, stamp_ns: 6 },
  ] as unknown as Parameters<typeof columnsOf>[0];
  const pairs = columnsOf(rows);
  assert.deepEqual(pairs.stamp_ns, [5, 6]);
  const { projected, off, error_px, range_m, angle_deg } = residualsOf(result, pairs);
  assert.ok(Math.abs((projected.u[0] ?? 0) - 40) < 1e-9 && Math.abs((projected.v[0] ?? 0) - 40) < 1e-9);
  assert.ok(Math.abs((off.u[0] ?? 0) - 3) < 1e-9 && Math.abs((off.v[0] ?? 0) - 4) < 1e-9);
  assert.ok(Math.abs((error_px[0] ?? 0) - 5) < 1e-9);
  assert.equal(range_m[0], Math.hypot(10, 1));
  assert.ok(Math.abs((angle_deg[0] ?? 0) - (Math.atan(0.1) * 180) / Math.PI) < 1e-9);
  assert.ok(Number.isNaN(off.u[1]) && Number.isNaN(projected.v[1]));
  assert.equal(error_px[1], Math.hypot(100, 80));
});

test("rings have equally many of the pairs that count", () => {
  const angle_deg = Float64Array.from([4, 1, 2, 3, 9]);
  const error_px = Float64Array.from([7, 3, 4, 1, 1000]);
  const rings = ringsOf({ angle_deg, error_px } as Residuals, [0, 1, 2, 3], 2);
  assert.deepEqual(rings, [
    [1, 2, Math.sqrt(12.5)],
    [3, 4, 5],
  ]);
  assert.deepEqual(ringsOf({ angle_deg, error_px } as Residuals, []), []);
});

test("coverage counts pairs by range and by sixth of the image", () => {
  const pairs = { x: [], y: [], z: [], u: [-3, 0, 99, 51], v: [] };
  const counts = coverageOf(pairs, { range_m: Float64Array.from([3, 6, 50, 12]) } as Residuals, 100);
  assert.deepEqual(
    counts.map((row) => row.join("")),
    ["100000", "100000", "000100", "000000", "000001"],
  );
});
