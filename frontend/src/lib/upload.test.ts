import assert from "node:assert/strict";
import { test } from "node:test";
import { partsOf } from "./upload.ts";

test("parts cover the file once, in order", () => {
  assert.deepEqual(partsOf(10, 4), [
    { number: 1, start: 0, end: 4 },
    { number: 2, start: 4, end: 8 },
    { number: 3, start: 8, end: 10 },
  ]);
});

test("a file of whole parts has no empty last one", () => {
  assert.equal(partsOf(8, 4).length, 2);
});

test("an empty file is one empty part", () => {
  assert.deepEqual(partsOf(0, 4), [{ number: 1, start: 0, end: 0 }]);
});
