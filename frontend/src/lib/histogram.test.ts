import assert from "node:assert/strict";
import { test } from "node:test";
import { histogram } from "./histogram.ts";

test("every value is counted once, outliers in the last bin", () => {
  const values = [...Array.from({ length: 99 }, (_, i) => i / 99), 1000];
  const { counts, width } = histogram(values, 10);
  assert.equal(counts.reduce((sum, count) => sum + count, 0), 100);
  assert.ok(width < 0.2);
  assert.ok((counts.at(-1) ?? 0) >= 1);
});

test("no values and equal values do no harm", () => {
  assert.deepEqual(histogram([], 2).counts, [0, 0]);
  assert.deepEqual(histogram([0, 0], 2).counts, [2, 0]);
});
