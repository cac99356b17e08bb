import assert from "node:assert/strict";
import { test } from "node:test";
import type { CalibrationTemplate } from "./api/schema.ts";
import { locksOf, newTemplate, templateInWords, requestOf } from "./templates.ts";

test("what is as usual is not said, but models and folds are", () => {
  assert.equal(requestOf(newTemplate()).models, undefined);
  assert.deepEqual(requestOf({ ...newTemplate(), models: ["pinhole"] }).models, ["pinhole"]);
  assert.equal(templateInWords(newTemplate()), "pinhole, brown_conrady, kannala_brandt; 5 folds");
});

test("what was chosen is said", () => {
  const asked: CalibrationTemplate = {
    ...newTemplate(),
    ...{ models: ["pinhole"], preset: "paper", search: "euler", folds: 0, seed: 0, publish: "recommended" },
    ...{ line_time_us: 29.4, loss: "mean", outliers: "keep" },
    ...{ intrinsics_as: "locked", locked: { c_x: 960 }, bounds: { skew: [-0.1, 0.1] } },
  };
  assert.equal(
    templateInWords(asked),
    "pinhole; preset paper; euler; a stated lens does not change; c_x locked at 960; skew fitted; mean loss; outliers kept; rolling shutter of 29.4 µs a row; nothing held out; seed 0; publish what is recommended",
  );
});

test("locks are read by name, and what does not read so is none", () => {
  assert.deepEqual(locksOf(" skew=0, t_z = -0.3,"), { skew: 0, t_z: -0.3 });
  assert.deepEqual(locksOf(""), {});
  for (const wrong of ["skew", "skew=", "=1", "skew=a", "skew=1=2"]) assert.equal(locksOf(wrong), null, wrong);
});
