import assert from "node:assert/strict";
import { test } from "node:test";
import { histogram } from "./histogram.ts";

test("every value is counted once, outliers in the last bin", () => {
  const values = [...Array.from({ length: 99 }, (_, i) => i / 99), 1000];
  const { counts, width } = histogram(values, 10);
  assert.equal(
    counts.reduce((sum, count) => sum + count, 0),
    100,
  );
  assert.ok(width < 0.2);
  assert.ok((counts.at(-1) ?? 0) >= 1);
});

test("outliers that are named do not set the scale", () => {
  const good = Array.from({ length: 90 }, (_, i) => i / 90);
  const values = [...good, ...Array.from({ length: 10 }, () => 500)];
  assert.ok(histogram(values, 10).width > 1, "ten in a hundred are too many for a quantile");
  const { counts, width } = histogram(values, 10, good);
  assert.ok(width < 0.1);
  assert.ok((counts.at(-1) ?? 0) >= 10);
  assert.equal(
    counts.reduce((sum, count) => sum + count, 0),
    100,
  );
});

test("no values and equal values do no harm", () => {
  assert.deepEqual(histogram([], 2).counts, [0, 0]);
  assert.deepEqual(histogram([0, 0], 2).counts, [2, 0]);
});
