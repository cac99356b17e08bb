import assert from "node:assert/strict";
import { test } from "node:test";
import type { DriftStep } from "./api/schema.ts";
import { ticks, timeTicks } from "./axes.ts";
import { driftLines, jumpsOf } from "./drift.ts";

const apart = (turn_deg: number[], shift_mm: number[], differs = false): object => ({ turn_deg, shift_mm, differs });
const step = (day: number, more: object): DriftStep =>
  ({
    at: `2026-03-0${day}T12:00:00Z`,
    std: { rotation_y: 0.05, t_y: 0.004 },
    from_first: null,
    from_previous: null,
    withdrawn: null,
    ...more,
  }) as unknown as DriftStep;

const STEPS = [
  step(1, { withdrawn: { reason: "bent" } }),
  step(2, {}),
  step(3, { from_first: apart([0.1, 0.2, 0.3], [1, 2, 3]), from_previous: apart([0, 0, 0], [0, 0, 0], true) }),
];

void test("lines begin at the first result that stands, deviations in the unit of the values", () => {
  const [, y] = driftLines(STEPS, "shift");
  assert.deepEqual(
    y?.points.map(({ value, std, withdrawn }) => [value, std, withdrawn]),
    [
      [0, 4, false],
      [2, 4, false],
    ],
  );
  const [x] = driftLines(STEPS, "turn");
  assert.deepEqual(
    x?.points.map(({ value, std }) => [value, std]),
    [
      [0, null],
      [0.1, null],
    ],
  );
});

void test("a jump is where a result that stands differs from the one before", () => {
  assert.deepEqual(jumpsOf(STEPS), [Date.parse("2026-03-03T12:00:00Z")]);
  const withdrawn = step(4, { from_previous: apart([0, 0, 0], [0, 0, 0], true), withdrawn: { reason: "bent" } });
  assert.deepEqual(jumpsOf([withdrawn]), []);
});

void test("times have few round ticks inside of the axis, whatever its length", () => {
  const start = Date.parse("2026-03-01T10:07:00Z");
  for (const length of [60_000, 3_600_000, 86_400_000, 40 * 86_400_000, 3000 * 86_400_000]) {
    const found = timeTicks(start, start + length, 5);
    assert.ok(found.length >= 1 && found.length <= 6, `${length}: ${found.length}`);
    assert.ok(found.every(({ at, said }) => at >= start && at <= start + length && said));
  }
  assert.deepEqual(ticks(0, 10, 5), [0, 2, 4, 6, 8, 10]);
});
