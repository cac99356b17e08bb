import assert from "node:assert/strict";
import { test } from "node:test";
import { projectionOf, type Intrinsics, type Mount } from "../overlay/projection.ts";
import { expectationOf, type OwnPair } from "./expectation.ts";

const SIZE = { width: 1280, height: 720 };
const NOMINAL: Mount = {
  rotation: [
    [0, -1, 0],
    [0, 0, -1],
    [1, 0, 0],
  ],
  translation: [0, -0.2, 0],
};
/** The true mount is turned by ten degrees and lies a hand's width beside the nominal one. */
const [COS, SIN] = [Math.cos(0.17), Math.sin(0.17)];
const MOUNT: Mount = {
  rotation: [
    [-SIN, -COS, 0],
    [0, 0, -1],
    [COS, -SIN, 0],
  ],
  translation: [0.1, -0.25, -0.08],
};
const CENTRE = { c_x: 650, c_y: 350 };
const LENSES: Intrinsics[] = [
  { model: "pinhole", f_x: 1000, f_y: 1000, ...CENTRE },
  { model: "brown_conrady", f_x: 760, f_y: 765, ...CENTRE, k1: -0.28, k2: 0.07 },
  { model: "kannala_brandt", f_x: 480, f_y: 480, ...CENTRE, k1: 0.02, k2: -0.01, k3: 0, k4: 0 },
];

/** Uniform numbers in [0, 1): Park and Miller's generator. */
function numbers(seed: number): () => number {
  let state = seed;
  return () => (state = (state * 48271) % 2147483647) / 2147483647;
}

/** Marks of a walk at one height, with errors of a pixel and a half; one in twenty is anywhere within 200 px. */
function walk(lens: Intrinsics, seed: number, count: number, wrong = 0.05): OwnPair[] {
  const next = numbers(seed);
  const normal = (): number => Math.sqrt(-2 * Math.log(1 - next())) * Math.cos(2 * Math.PI * next());
  const project = projectionOf(lens);
  const pairs: OwnPair[] = [];
  const pixel = { u: 0, v: 0 };
  while (pairs.length < count) {
    const [range, azimuth] = [4 + 16 * next(), -0.9 + 1.8 * next()];
    const [x, y, z] = [range * Math.cos(azimuth), range * Math.sin(azimuth), 0.35 + 0.05 * normal()];
    const at = MOUNT.rotation.map((row, i) => row[0] * x + row[1] * y + row[2] * z + (MOUNT.translation[i] ?? 0));
    if (!project(at[0] ?? 0, at[1] ?? 0, at[2] ?? 0, pixel)) continue;
    if (pixel.u < 0 || pixel.v < 0 || pixel.u > SIZE.width - 1 || pixel.v > SIZE.height - 1) continue;
    const sigma = next() < wrong ? 80 : 1.5;
    pairs.push({ x, y, z, u: pixel.u + sigma * normal(), v: pixel.v + sigma * normal() });
  }
  return pairs;
}

test("good marks are hardly asked about, and marks on another corner of the board are", () => {
  for (const lens of LENSES) {
    const asked = { good: 0, far: 0, all: 0 };
    for (let seed = 1; seed <= 20; seed += 1) {
      const expected = expectationOf(walk(lens, seed, 25), NOMINAL, SIZE);
      assert.ok(expected);
      for (const pair of walk(lens, 100 + seed, 25, 0)) {
        asked.all += 1;
        if (expected.doubts(pair, pair)) asked.good += 1;
        const doubt = expected.doubts(pair, { u: pair.u + 27, v: pair.v + 36 });
        if (!doubt) continue;
        asked.far += 1;
        assert.ok(Math.abs(doubt.distance - 45) < 25, `${doubt.distance}`);
        assert.ok(doubt.usual < doubt.distance);
      }
    }
    console.log(lens.model, asked);
    assert.ok(asked.good <= 0.01 * asked.all, `${lens.model}: ${asked.good} of ${asked.all}`);
    assert.ok(asked.far >= 0.95 * asked.all, `${lens.model}: ${asked.far} of ${asked.all}`);
  }
});

test("few marks let nothing be expected, and marks anywhere let nothing be doubted", () => {
  const lens = LENSES[0];
  assert.ok(lens);
  const elsewhere = walk(lens, 7, 12, 0).map((pair) => ({ ...pair, u: pair.u + 60 }));
  for (const count of [0, 1, 3, 5]) {
    const expected = expectationOf(walk(lens, 3, count, 0), NOMINAL, SIZE);
    for (const pair of elsewhere) assert.equal(expected?.doubts(pair, pair) ?? null, null);
  }
  const next = numbers(9);
  const anywhere = (): OwnPair[] =>
    walk(lens, 11, 15, 0).map((pair) => ({ ...pair, u: SIZE.width * next(), v: SIZE.height * next() }));
  const expected = expectationOf(anywhere(), NOMINAL, SIZE);
  assert.ok(anywhere().every((pair) => !expected?.doubts(pair, pair)));
});
