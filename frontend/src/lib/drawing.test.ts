import assert from "node:assert/strict";
import { test } from "node:test";
import { drawingOf, type Handle, type Plane, type Spot } from "./drawing.ts";
import { maskOf } from "./mask.ts";
import type { Extent } from "./points/cloud.ts";
import { metresAt, pixelsOf } from "./points/flat.ts";
import { parseRegion, type Part, type Region } from "./region.ts";

const REACH: Extent = { min: [-5, -10, -2], max: [40, 10, 3] };
const BOX: Part = { box: { min: [2, -3, -1], max: [6, 3, 1], yaw_deg: 30 } };
const POLYGON: Part = {
  polygon: [
    [2, -3],
    [10, -6],
    [10, 6],
  ],
  z: [-1, 1],
};

function handle(part: Part | undefined, plane: Plane, key: string): Handle & { moved: (to: Spot) => Part } {
  assert.ok(part);
  return handleOf({ all: [part] }, plane, `all.0${key}`);
}

function handleOf(region: Region, plane: Plane, key: string): Handle & { moved: (to: Spot) => Part } {
  const { handles } = drawingOf(region, plane, REACH);
  const found = handles.find((one) => one.key === key);
  assert.ok(found, `${key} of ${handles.map((one) => one.key).join(" ")}`);
  const moved = (to: Spot): Part => {
    const [part] = found.move(to).all;
    assert.ok(part);
    return part;
  };
  return { ...found, moved };
}

function near(a: readonly number[], b: readonly number[], within: number): void {
  a.forEach((value, i) => assert.ok(Math.abs(value - (b[i] ?? NaN)) <= within, `${a.join()} is not ${b.join()}`));
}

test("a corner of a turned box goes where it is put, and the opposite one stays", () => {
  const opposite = handle(BOX, "top", ".c2").at;
  const moved = handle(BOX, "top", ".c0").moved([0, -4]);
  near(handle(moved, "top", ".c0").at, [0, -4], 0.02);
  near(handle(moved, "top", ".c2").at, opposite, 0.02);
  assert.deepEqual(parseRegion(JSON.stringify({ all: [moved] })).all, [moved]);
});

test("a box turned by a quarter has its sides exchanged, and what is cut out has an outline", () => {
  const quarter: Part = { box: { min: [4, -1, 0], max: [8, 1, 2], yaw_deg: 90 } };
  const [box, polygon] = drawingOf({ all: [quarter], none: [POLYGON] }, "top", REACH).outlines;
  near([7, -2, 7, 2, 5, 2, 5, -2], (box?.spots ?? []).flat(), 1e-9);
  assert.deepEqual([polygon?.spots, polygon?.cut], ["polygon" in POLYGON && POLYGON.polygon, true]);
});

test("a box is moved, turned, and never turned inside out", () => {
  const there = handle(BOX, "top", ".m").moved([20, 5]);
  near(handle(there, "top", ".m").at, [20, 5], 0.01);
  const turned = handle(BOX, "top", ".t").moved([4, 10]);
  assert.ok("box" in turned && turned.box.yaw_deg === 90);
  const flat = handle({ box: { min: [2, -3, -1], max: [6, 3, 1] } }, "side", ".zmin").moved([0, 9]);
  assert.ok("box" in flat && flat.box.min[2] < flat.box.max[2]);
  const thin = handle({ box: { min: [2, -3, -1], max: [6, 3, 1] } }, "front", ".max").moved([-9, 0]);
  assert.ok("box" in thin && thin.box.min[1] < thin.box.max[1]);
});

test("a polygon's corners are moved, added and removed, down to three", () => {
  const grown = handle(POLYGON, "top", ".n0").moved([6, -8]);
  assert.ok("polygon" in grown);
  assert.deepEqual(grown.polygon, [
    [2, -3],
    [6, -8],
    [10, -6],
    [10, 6],
  ]);
  assert.deepEqual(handle(grown, "top", ".c1").remove?.(), { all: [POLYGON] });
  assert.equal(handle(POLYGON, "top", ".c1").remove, undefined);
  const lower = handle(POLYGON, "side", ".zmin").moved([0, -1.5]);
  assert.ok("polygon" in lower && lower.z?.[0] === -1.5 && lower.z[1] === 1);
});

test("inequalities are lines, circles and rays; what a plane does not show has no handle", () => {
  const of = (quantity: string, value: number, divided_by?: string): Region =>
    parseRegion(JSON.stringify({ all: [{ quantity, divided_by, op: ">", value }] }));
  const cases: [Region, Plane, [number, number], number][] = [
    [of("x", 2), "top", [3.5, 0], 3.5],
    [of("y", 2), "top", [0, -4], -4],
    [of("z", -1.7), "side", [9, -1.2], -1.2],
    [of("range", 20), "top", [3, 4], 5],
    [of("azimuth_deg", 10), "top", [5, 5], 45],
    [of("elevation_deg", 1), "side", [10, 10], 45],
    [of("z", 0.1, "x"), "side", [10, 2], 0.2],
  ];
  for (const [region, plane, to, value] of cases) {
    const moved = drawingOf(region, plane, REACH).handles[0]?.move(to).all[0];
    assert.ok(moved && "quantity" in moved && Math.abs(moved.value - value) < 1e-9, JSON.stringify(moved));
  }
  for (const [region, plane] of [
    [of("z", 0), "top"],
    [of("azimuth_deg", 5), "front"],
    [of("range", 5, "x"), "top"],
  ] as const) {
    assert.deepEqual(drawingOf(region, plane, REACH), { outlines: [], handles: [] });
  }
});

test("a part is changed where it stands, and what is cut out is drawn as cut", () => {
  const region: Region = { all: [POLYGON, { quantity: "x", op: "<", value: 4 }], none: [BOX] };
  const { outlines } = drawingOf(region, "top", REACH);
  assert.deepEqual(
    outlines.map((one) => [one.closed, one.cut]),
    [
      [true, false],
      [false, false],
      [true, true],
    ],
  );
  const moved = handleOf(region, "top", "none.0.m").move([9, 9]);
  assert.ok(moved.all[0] === POLYGON && moved.none?.length === 1);
  near(handleOf(moved, "top", "none.0.m").at, [9, 9], 0.01);
});

test("pixels and metres of a flat picture are each other's inverse", () => {
  // 20 m across 400 px, y to the left as the LiDAR looks.
  const seen = {
    matrix: [0, 0, 0.01, 0, -0.1, 0, 0, 0, 0, 0.2, 0, 0, 0.1, -0.2, 0, 1],
    width: 400,
    height: 200,
    pictures: 1,
  };
  near(metresAt(seen, "front", pixelsOf(seen, "front", [3, -1.5])), [3, -1.5], 1e-9);
});

test("points outside of the bounding box of a shape are cut, on its bound they are kept", () => {
  const points = Float32Array.from([2, -3, 0, 6.01, 0, 0, 4, 0, 1, 4, 0, 1.01]);
  assert.deepEqual([...maskOf({ all: [{ box: { min: [2, -3, -1], max: [6, 3, 1] } }] }, points)], [1, 0, 1, 0]);
});
