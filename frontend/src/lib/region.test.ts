import assert from "node:assert/strict";
import { test } from "node:test";
import { DEFAULT_ROWS, describe, parseRegion, regionOf, rowsOf } from "./region.ts";

test("rows become a conjunction and come back", () => {
  assert.deepEqual(rowsOf(parseRegion(JSON.stringify(regionOf(DEFAULT_ROWS)))), [...DEFAULT_ROWS]);
});

test("a region with an alternative is no list of rows", () => {
  const text = '{"or": [{"quantity": "x", "op": ">", "value": 0}, {"quantity": "y", "op": "<", "value": 1}]}';
  assert.equal(rowsOf(parseRegion(text)), null);
  assert.equal(describe(parseRegion(text)), "x > 0 or y < 1");
});

test("a ratio is described as one", () => {
  assert.equal(describe({ quantity: "z", divided_by: "x", op: ">", value: 0.2 }), "z / x > 0.2");
});

test("mistakes are named with their place", () => {
  assert.throws(() => parseRegion('{"and": [{"quantity": "w", "op": ">", "value": 0}]}'), /region\.and\[0\]\.quantity/);
  assert.throws(() => parseRegion('{"quantity": "x", "op": "=", "value": 0}'), /region\.op/);
  assert.throws(() => parseRegion('{"quantity": "x", "op": ">", "value": "0"}'), /region\.value/);
  assert.throws(() => parseRegion("{"), /not JSON/);
});
