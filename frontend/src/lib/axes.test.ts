import assert from "node:assert/strict";
import { test } from "node:test";
import { rangeOf } from "./axes.ts";

test("a range holds all numbers with a margin, and begins at a number that is to be its end", () => {
  assert.deepEqual(rangeOf([2, NaN, 12], 0.1), [1, 13]);
  assert.deepEqual(rangeOf([2, 10], 0.1, [0]), [0, 11]);
  assert.deepEqual(rangeOf([3]), [2.5, 3.5]);
  assert.deepEqual(rangeOf([]), [0, 1]);
});
