import assert from "node:assert/strict";
import { test } from "node:test";
import { DEFAULT_ROWS, describe, parseRegion, withParts, type Region } from "./region.ts";

const X = { quantity: "x", op: ">", value: 0 };
const SHAPES = {
  all: [
    {
      polygon: [
        [2, -3],
        [30, -6],
        [30, 6],
      ],
      z: [-1.6, 0.8],
    },
    { quantity: "range", divided_by: null, op: "<", value: 28 },
  ],
  none: [{ box: { min: [1, 2, 3], max: [4, 5, 6], yaw_deg: 20 } }],
};

const read = (region: unknown): Region => parseRegion(JSON.stringify(region));

test("the default comes back as it was, and so do shapes and what is cut out", () => {
  assert.deepEqual(read({ all: DEFAULT_ROWS }), { all: [...DEFAULT_ROWS] });
  assert.deepEqual(read(SHAPES), SHAPES);
});

test("a list of nothing that is cut out is left out", () => {
  assert.deepEqual(read({ all: [X], none: [] }), read({ all: [X], none: null }));
  const shapes = read(SHAPES);
  assert.deepEqual(withParts(shapes, "none", []), { all: shapes.all });
});

test("a region is told in words", () => {
  assert.equal(
    describe(read(SHAPES)),
    "polygon (3 corners, z -1.6 to 0.8) and range < 28, without box (x 1 to 4, y 2 to 5, z 3 to 6, turned by 20°)",
  );
  assert.equal(describe(read({ all: [{ ...X, quantity: "z", divided_by: "x", value: 0.2 }] })), "z / x > 0.2");
  assert.equal(describe(read({ all: [X], up: [0, 0.342, 0.94] })), "in level axes: x > 0");
});

test("mistakes are named with their place", () => {
  const cases: [unknown, RegExp][] = [
    [[X], /region: expected/],
    [X, /region: it has beside "quantity"/],
    [{ none: [X] }, /region\.all: expected a filled list/],
    [{ all: [X], none: X }, /region\.none: expected a list/],
    [{ all: [{ ...X, quantity: "w" }] }, /region\.all\[0\]\.quantity/],
    [{ all: [{ ...X, op: "=" }] }, /region\.all\[0\]\.op/],
    [{ all: [X, { ...X, value: "0" }] }, /region\.all\[1\]\.value/],
    [{ all: [{ box: { min: [0, 0], max: [1, 1, 1] } }] }, /region\.all\[0\]\.box\.min/],
    [{ all: [X], none: [{ box: { min: [0, 0, 0], max: [1, 0, 1] } }] }, /region\.none\[0\]\.box: .*not below max in y/],
    [{ all: [{ polygon: [X, X] }] }, /region\.all\[0\]\.polygon/],
    [{ all: [X], up: [0, 0, 0] }, /direction/],
    [{ all: [X], up: [0, 1] }, /region\.up/],
  ];
  for (const [region, place] of cases) assert.throws(() => read(region), place);
  assert.throws(() => parseRegion("{"), /not JSON/);
});
