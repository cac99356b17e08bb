import assert from "node:assert/strict";
import { test } from "node:test";
import type { DetectionView, VertexView } from "./api/schema.ts";
import { ticks } from "./axes.ts";
import { cornerPlace, cornerWords } from "./corners.ts";
import { board, ellipsoid, judgedSweeps, kindsOf, nextOf, runsOf, sigmasMm } from "./judging.ts";

const vertex = (sweep_index: number, flags: string[] = []): VertexView =>
  ({
    sweep_index,
    x: 6,
    y: -2,
    z: 0.7,
    flags: flags.map((name) => ({ name, sentence: name })),
    covariance: [
      [4e-6, 1e-6, 0],
      [1e-6, 9e-6, 2e-6],
      [0, 2e-6, 1e-4],
    ],
  }) as unknown as VertexView;
const detection = {
  reasons: { no_points: "no point lies in the region" },
  counts: {
    refused_sweeps: {
      no_points: [
        [0, 1],
        [5, 5],
      ],
      too_uncertain: [[3, 3]],
    },
  },
} as unknown as DetectionView;

test("each sweep has its verdict and reason", () => {
  const judged = judgedSweeps(detection, [vertex(2), vertex(4, ["head_above", "occluded"])], 7);
  assert.deepEqual(
    judged.map((one) => `${one.verdict}: ${one.reason}`),
    [
      "refused: no points",
      "refused: no points",
      "found: ",
      "refused: too uncertain",
      "uncertain: head above, occluded",
      "refused: no points",
      "refused: ",
    ],
  );
  assert.deepEqual(
    judged.map((one) => one.sentence),
    ["no point lies in the region", "no point lies in the region", "", "", "head_above; occluded"].concat(
      "no point lies in the region",
      "",
    ),
  );
  assert.deepEqual(
    runsOf(judged).map(({ first, last }) => [first, last]),
    [
      [0, 1],
      [2, 2],
      [3, 3],
      [4, 4],
      [5, 5],
      [6, 6],
    ],
  );
  const kinds = kindsOf(judged);
  assert.deepEqual(
    kinds.map((kind) => kind.count),
    [1, 1, 3, 1, 1],
  );
  const none = { verdict: "refused", reason: "no points" } as const;
  assert.deepEqual([nextOf(judged, none, -1), nextOf(judged, none, 1), nextOf(judged, none, 5)], [0, 5, 0]);
  assert.equal(nextOf(judged, { verdict: "refused", reason: "rain" }, 0), -1);
});

test("the curves lie on the ellipsoid of the covariance", () => {
  const one = vertex(0);
  const lines = ellipsoid(one, 2, "#000");
  assert.ok(lines && one.covariance);
  const [[a, b, c], [, d, e], [, , f]] = one.covariance as [number[], number[], number[]] as [
    [number, number, number],
    [number, number, number],
    [number, number, number],
  ];
  const det = a * (d * f - e * e) - b * (b * f - e * c) + c * (b * e - d * c);
  for (let i = 0; i < lines.ends.length; i += 3) {
    const [x = 0, y = 0, z = 0] = lines.ends.slice(i, i + 3);
    // Small errors: what the point differs by in azimuth, elevation and range, to first order.
    const level = Math.hypot(6, -2);
    const range = Math.hypot(level, 0.7);
    const [dx, dy, dz] = [x - 6, y + 2, z - 0.7];
    const s = [
      (2 * dx + 6 * dy) / (level * level),
      ((-6 * 0.7 * dx) / level + (2 * 0.7 * dy) / level + level * dz) / (range * range),
      (6 * dx - 2 * dy + 0.7 * dz) / range,
    ] as [number, number, number];
    const [p, q, r] = s;
    const squared =
      (p * p * (d * f - e * e) +
        q * q * (a * f - c * c) +
        r * r * (a * d - b * b) +
        2 * p * q * (c * e - b * f) +
        2 * p * r * (b * e - c * d) +
        2 * q * r * (b * c - a * e)) /
      det;
    assert.ok(Math.abs(squared - 4) < 1e-9, `${squared}`);
  }
  assert.equal(ellipsoid({ ...one, covariance: null }, 2, "#000"), null);
  const sigmas = sigmasMm(one);
  assert.ok(sigmas && Math.abs(sigmas[0] - 2 * Math.hypot(6, 2)) < 1e-9 && Math.abs(sigmas[2] - 10) < 1e-9);
});

test("ticks are round and inside", () => {
  assert.deepEqual(ticks(0, 30, 6), [0, 5, 10, 15, 20, 25, 30]);
  assert.deepEqual(ticks(-0.31, 0.52, 5), [-0.2, 0, 0.2, 0.4]);
  assert.deepEqual(ticks(3, 3, 4), [3]);
});

test("the board is drawn between the corners that are known", () => {
  const tip = vertex(0);
  assert.equal(board(tip, "red"), null);
  const corner = (name: string, y: number, z: number): object => ({ corner: name, x: 6, y, z, covariance: [] });
  const crossed = 18;
  const edge = 6;
  const whole = {
    ...tip,
    corners: [corner("left", -1.6, 0.3), corner("right", -2.4, 0.3), corner("bottom", -2, -0.1)],
  };
  assert.equal(board(whole as unknown as VertexView, "red")?.ends.length, 3 * crossed + 4 * edge);
  const half = { ...tip, corners: [corner("left", -1.6, 0.3), corner("bottom", -2, -0.1)] };
  const lines = board(half as unknown as VertexView, "red")?.ends ?? [];
  assert.equal(lines.length, 2 * crossed + 2 * edge);
  assert.deepEqual(lines.slice(-edge), [6, -1.6, 0.3, 6, -2, 0.7]);
});

test("the corners of a board with level edges have names and places of their own", () => {
  const words = (upper: number): string[] =>
    (["top", "left", "right", "bottom"] as const).map((corner) => cornerWords(corner, upper));
  assert.deepEqual(words(0), ["top corner", "left corner", "right corner", "bottom corner"]);
  assert.deepEqual(words(1), ["upper left corner", "lower left corner", "upper right corner", "lower right corner"]);
  assert.deepEqual(words(-1), ["upper right corner", "upper left corner", "lower right corner", "lower left corner"]);
  const signs = (upper: number): number[] => cornerPlace("top", upper).map((value) => Math.sign(Math.round(9 * value)));
  assert.deepEqual(signs(0), [0, -1]);
  assert.deepEqual(signs(1), [-1, -1]);
  assert.deepEqual(signs(-1), [1, -1]);
});
