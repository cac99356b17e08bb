import assert from "node:assert/strict";
import { test } from "node:test";
import { cornersOf, outlinesOf } from "./plan.ts";

test("a box turned by a quarter has its sides exchanged", () => {
  const corners = cornersOf({ min: [4, -1, 0], max: [8, 1, 2], yaw_deg: 90 });
  const x = corners.map((corner) => Math.round(corner[0] * 1e6) / 1e6);
  const y = corners.map((corner) => Math.round(corner[1] * 1e6) / 1e6);
  assert.deepEqual([Math.min(...x), Math.max(...x)], [5, 7]);
  assert.deepEqual([Math.min(...y), Math.max(...y)], [-2, 2]);
});

test("shapes are found wherever they stand, inequalities have none", () => {
  const triangle: [number, number][] = [
    [1, 0],
    [5, 2],
    [5, -2],
  ];
  const inequality = { quantity: "x", divided_by: null, op: ">", value: 0 } as const;
  const box = { box: { min: [0, 0, 0] as [number, number, number], max: [1, 1, 1] as [number, number, number] } };
  const found = outlinesOf({ and: [inequality, { or: [{ polygon: triangle }, { not: box }] }] });
  assert.deepEqual(found[0], triangle);
  assert.equal(found.length, 2);
  assert.deepEqual(outlinesOf(inequality), []);
});
