import assert from "node:assert/strict";
import { test } from "node:test";
import { DEFAULT_ROWS, describe, levelOf, parseRegion, partsOf, wholeOf, type Region } from "./region.ts";

const read = (text: string): Region => levelOf(parseRegion(text)).tree;

test("rows become a conjunction and come back", () => {
  assert.deepEqual(partsOf(read(JSON.stringify({ and: DEFAULT_ROWS }))), [...DEFAULT_ROWS]);
});

test("a region with an alternative is no list of rows", () => {
  const text = '{"or": [{"quantity": "x", "op": ">", "value": 0}, {"quantity": "y", "op": "<", "value": 1}]}';
  assert.equal(partsOf(read(text)), null);
  assert.equal(describe(parseRegion(text)), "x > 0 or y < 1");
});

const SHAPES = {
  and: [
    {
      polygon: [
        [2, -3],
        [30, -6],
        [30, 6],
      ],
      z: [-1.6, 0.8],
    },
    { box: { min: [1, 2, 3], max: [4, 5, 6], yaw_deg: 20 } },
    { quantity: "range", divided_by: null, op: "<", value: 28 },
  ],
};

test("shapes are leaves: they come back as they were", () => {
  const region = read(JSON.stringify(SHAPES));
  assert.deepEqual(region, SHAPES);
  assert.deepEqual(partsOf(region), SHAPES.and);
  assert.equal(partsOf({ or: [region] }), null);
});

test("shapes and their opposite are described", () => {
  assert.equal(
    describe({ not: SHAPES }),
    "not (polygon (3 corners, z -1.6 to 0.8) and box (x 1 to 4, y 2 to 5, z 3 to 6, turned by 20°) and range < 28)",
  );
});

test("mistakes in shapes are named with their place", () => {
  assert.throws(() => parseRegion('{"box": {"min": [0, 0], "max": [1, 1, 1]}}'), /region\.box\.min/);
  assert.throws(() => parseRegion('{"box": {"min": [0, 0, 0], "max": [1, 0, 1]}}'), /not below max in y/);
  assert.throws(() => parseRegion('{"or": [{"polygon": [[0, 0], [1, 1]]}]}'), /region\.or\[0\]\.polygon/);
  assert.throws(() => parseRegion('{"not": {"polygon": [[0, 0], [1, 1], [1, "0"]]}}'), /not\.polygon\[2\]/);
  assert.throws(() => parseRegion('{"polygon": [[0, 0], [1, 1], [1, 0]], "z": [2, 1]}'), /region\.z/);
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

test("a region in level axes keeps its direction of up", () => {
  const level = { level: { and: [{ quantity: "z", op: ">", value: -1.7 }] }, up: [0, 0.342, 0.94] };
  const whole = parseRegion(JSON.stringify(level));
  const { tree, up } = levelOf(whole);
  assert.deepEqual(up, [0, 0.342, 0.94]);
  assert.deepEqual(JSON.parse(JSON.stringify(wholeOf(tree, up))), JSON.parse(JSON.stringify(whole)));
  assert.equal(describe(whole), "in level axes: z > -1.7");
  assert.throws(() => parseRegion('{"level": {"quantity": "x", "op": ">", "value": 0}}'), /region\.up/);
  assert.throws(() => parseRegion('{"level": {"quantity": "x", "op": ">", "value": 0}, "up": [0, 0, 0]}'), /direction/);
  assert.throws(() => parseRegion('{"level": {"quantity": "w", "op": ">", "value": 0}, "up": [0, 0, 1]}'), /level/);
});
