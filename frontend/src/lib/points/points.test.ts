import assert from "node:assert/strict";
import { test } from "node:test";
import { cloudOf, extentOf, factsOf } from "./cloud.ts";
import { COLOURINGS, palette, shadesOf, STOPS } from "./colours.ts";
import { spreadOver } from "./load.ts";
import { pick, toScreen } from "./picking.ts";
import type { Sweep } from "./sweep.ts";
import { circlesOf, placeOf } from "./views.ts";

/** A sweep of `count` points along x, one ring after the other. */
function sweepOf(count: number, index = 0, ringCount = 4): Sweep & { index: number } {
  const numbers = Array.from({ length: count }, (_, i) => i);
  return {
    index,
    count,
    ringCount,
    positions: Float32Array.from(numbers.flatMap((i) => [i + 1, -i, index])),
    rings: Uint16Array.from(numbers, (i) => Math.floor((i * ringCount) / count)),
    intensities: Float32Array.from(numbers, (i) => i % 256),
    timesNs: Float64Array.from(numbers, (i) => i * 1000),
  };
}

test("a cloud holds every point of its sweeps once, with all that belongs to it", () => {
  const cloud = cloudOf([sweepOf(1000, 3), sweepOf(500, 7)]);
  assert.equal(cloud.count, 1500);
  const seen = new Set<string>();
  for (let i = 0; i < cloud.count; i += 1) {
    const facts = factsOf(cloud, i);
    assert.equal(facts.z, facts.sweep);
    assert.equal(facts.timeNs, (facts.x - 1) * 1000);
    assert.equal(facts.ring, Math.floor(((facts.x - 1) * 4) / (facts.sweep === 3 ? 1000 : 500)));
    seen.add(`${facts.sweep} ${facts.x}`);
  }
  assert.equal(seen.size, 1500);
  assert.equal(cloudOf([]).count, 0);
  assert.equal(cloudOf([sweepOf(1)]).count, 1);
});

test("any first part of a cloud is spread over all of it", () => {
  for (const count of [997, 1000, 65_536]) {
    const cloud = cloudOf([sweepOf(count)]);
    for (const part of [0.1, 0.3]) {
      const first = Math.floor(part * count);
      const tenths = new Array<number>(10).fill(0);
      for (let i = 0; i < first; i += 1) {
        const tenth = Math.floor((10 * ((cloud.positions[3 * i] ?? 0) - 1)) / count);
        tenths[tenth] = (tenths[tenth] ?? 0) + 1;
      }
      for (const found of tenths)
        assert.ok(Math.abs(found - first / 10) < Math.max(6, 0.1 * (first / 10)), tenths.join());
    }
  }
});

test("what is known of a point", () => {
  const sweep = { ...sweepOf(1), positions: Float32Array.from([3, 4, 12]) };
  const facts = factsOf(cloudOf([sweep]), 0);
  assert.equal(facts.range, 13);
  assert.ok(Math.abs(facts.azimuthDeg - 53.1301) < 1e-3 && Math.abs(facts.elevationDeg - 67.3801) < 1e-3);
});

test("every colouring gives each point a share of the palette", () => {
  const cloud = cloudOf([sweepOf(1000)]);
  for (const by of COLOURINGS) {
    const { values, low, high } = shadesOf(cloud, by);
    assert.equal(values.length, 1000);
    assert.ok(values.every((value) => value >= 0 && value <= 1) && low < high, by);
  }
  assert.deepEqual([...new Set(shadesOf(cloud, "ring").values)].length, 4);
  // All at one height, and nothing at all.
  assert.ok(shadesOf(cloud, "height").values.every(Number.isFinite));
  assert.equal(shadesOf(cloudOf([]), "range").values.length, 0);
});

test("the palette grows lighter, and is seen on its background", () => {
  const lightness = ([r, g, b]: number[]): number => 0.3 * (r ?? 0) + 0.59 * (g ?? 0) + 0.11 * (b ?? 0);
  for (const dark of [true, false]) {
    const steps = palette(dark).map(lightness);
    assert.equal(steps.length, STOPS);
    for (let i = 1; i < steps.length; i += 1) assert.ok((steps[i] ?? 0) > (steps[i - 1] ?? 0));
    assert.ok(dark ? (steps[0] ?? 0) > 0.35 : (steps.at(-1) ?? 1) < 0.7);
  }
});

test("the point under the pointer is picked, the nearer one of two, and none far from any", () => {
  // x to the right, y up, z away from the eye, in a window of 200 x 100 pixels for -1 to 1.
  const matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  assert.deepEqual(toScreen(matrix, 200, 100, [0.5, 0.5, 0]), { x: 150, y: 25, depth: 0 });
  assert.equal(toScreen(matrix, 200, 100, [0, 0, 2]), null);
  const positions = Float32Array.from([0.5, 0.5, 0.9, 0.5, 0.5, -0.9, -0.5, 0, 0]);
  assert.equal(pick(positions, matrix, 200, 100, { x: 150, y: 25 }), 1);
  assert.equal(pick(positions, matrix, 200, 100, { x: 53, y: 52 }), 2);
  assert.equal(pick(positions, matrix, 200, 100, { x: 100, y: 90 }), -1);
});

test("flat views show the whole extent from their side", () => {
  const extent = { min: [0, -10, -2] as [number, number, number], max: [40, 10, 2] as [number, number, number] };
  const top = placeOf("top", extent, 2);
  assert.ok(top.flat && top.halfHeight * 2 >= 20 && top.halfHeight * 4 >= 40);
  assert.ok(top.position[2] > 40 && Math.abs(top.position[0] - 20) < 1e-9);
  assert.ok(placeOf("side", extent, 2).position[1] < -10 && placeOf("front", extent, 2).position[0] < 0);
  assert.deepEqual(placeOf("sensor", extent, 2).target, [0, 0, 0]);
  assert.ok(!placeOf("orbit", extent, 2).flat);
});

test("circles are round distances, at most five", () => {
  assert.deepEqual(circlesOf(4.9), [1, 2, 3, 4]);
  assert.deepEqual(circlesOf(33), [10, 20, 30]);
  for (const reach of [0.4, 7, 99, 480, 3000]) assert.ok(circlesOf(reach).length <= 16);
});

test("sweeps to be shown at once are spread over the recording and not too many", () => {
  const sweeps = Array.from({ length: 600 }, (_, index) => ({ index, points: 100_000 }));
  assert.deepEqual(spreadOver(sweeps), [100, 300, 500]);
  assert.equal(spreadOver(sweeps.map((one) => ({ ...one, points: 500 }))).length, 30);
  assert.deepEqual(spreadOver(sweeps.slice(0, 2).map((one) => ({ ...one, points: 900_000 }))), [1]);
  assert.deepEqual(spreadOver([]), []);
  // Five and a half hours at 10 Hz: more than a function takes as arguments.
  assert.equal(spreadOver(Array.from({ length: 200_000 }, (_, index) => ({ index, points: 100 }))).length, 30);
});

test("points of extents", () => {
  const extent = extentOf(cloudOf([sweepOf(100)]));
  assert.ok(extent.min[0] === 0 && extent.max[0] > 90 && extent.max[0] < 100);
  assert.ok(extent.max[1] === 0 && extent.min[1] < -89);
  assert.deepEqual(extentOf(cloudOf([])), { min: [0, 0, 0], max: [0, 0, 0] });
});
