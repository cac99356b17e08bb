import assert from "node:assert/strict";
import { test } from "node:test";
import type { CalibrationTemplate } from "./api/types.ts";
import { newTemplate, templateInWords } from "./templates.ts";

test("what is as usual is not said, but models and folds are", () => {
  assert.equal(templateInWords(newTemplate()), "pinhole, brown_conrady, kannala_brandt; 5 folds");
});

test("what was chosen is said", () => {
  const asked: CalibrationTemplate = {
    ...newTemplate(),
    ...{ models: ["pinhole"], preset: "paper", search: "euler", folds: 0, seed: 0, publish: "recommended" },
    line_time_us: 29.4,
  };
  assert.equal(
    templateInWords(asked),
    "pinhole; preset paper; euler; rolling shutter of 29.4 µs a row; nothing held out; seed 0; publish what is recommended",
  );
});
