import assert from "node:assert/strict";
import { test } from "node:test";
import { clockOffsetNs, clocksDiffer, factsOf, instant, utc } from "./facts.ts";

test("a moment is said in UTC with milliseconds", () => {
  assert.equal(utc(1_700_000_000_123_456_768), "2023-11-14 22:13:20.123 UTC");
});

test("a stamp is a moment in UTC, or seconds where its clock is not the Unix one", () => {
  assert.equal(instant(1_780_000_015_853_000_000), "2026-05-28 20:26:55.853 UTC");
  assert.equal(instant(15_853_000_000), "15.853 s");
});

test("facts are said in words, and what is absent or zero is not said", () => {
  const found = {
    first_ns: 1_700_000_000_123_456_768,
    together_s: 61.2,
    rate_hz: 14.998,
    transcoded: false,
    width: 960,
    height: 600,
    sizes: [{ width: 960, height: 600, count: 300 }],
    notes: ["One.", "Two: a_b."],
    time_source: "per_point",
    gaps: [{ after_ns: 1, duration_ns: 2 }],
    gap_count: 0,
    camera_info: null,
    jumps: [{ after_ns: 1_700_000_000_000_000_000, duration_ns: -2_500_000_000 }],
  };
  assert.deepEqual(
    factsOf(found).map((fact) => [fact.name, ...fact.lines]),
    [
      ["first message", "2023-11-14 22:13:20.123 UTC"],
      ["all sensors together", "61 s"],
      ["rate", "15.00 Hz"],
      ["images encoded anew", "no"],
      ["size", "960 × 600 (300 frames)"],
      ["notes", "One.", "Two: a_b."],
      ["times of the points", "per point"],
      ["jumps of the clock", "-2.500 s after 2023-11-14 22:13:20.000 UTC"],
    ],
  );
});

test("stated intrinsics are said by their names", () => {
  const K = [500, 0, 320.5, 0, 510, 240, 0, 0, 1];
  const [fact] = factsOf({ camera_info: { model: "brown_conrady", width: 640, height: 480, K, D: [0.1, 0] } });
  assert.deepEqual(fact?.lines, [
    "brown_conrady, 640 × 480",
    "f 500, 510; centre 320.500, 240 pixels",
    "distortion 0.1000, 0",
  ]);
});

test("an offset is proposed where the clocks of all cameras agree on it", () => {
  const of = (...offsets: (number | null)[]) => [
    { kind: "lidar", facts: { offset_ns: null } },
    ...offsets.map((offset_ns) => ({ kind: "camera", facts: { offset_ns } })),
  ];
  for (const [offsets, proposed, differ] of [
    [[], 0, false],
    [[null, null], 0, false],
    [[37e9], 37e9, false],
    [[37e9, 37.04e9], 37e9, false],
    [[37e9, 37.06e9], 0, true],
    [[37e9, null], 0, true],
    [[null, -1.2e9], 0, true],
    [[37e9, -37e9], 0, true],
  ] as [(number | null)[], number, boolean][]) {
    assert.equal(clockOffsetNs(of(...offsets)), proposed);
    assert.equal(clocksDiffer(of(...offsets)), differ);
  }
});
