import assert from "node:assert/strict";
import { test } from "node:test";
import type { ModelSummary } from "./api/schema.ts";
import { caution, errorOf, mergedNotes, outcomesOf } from "./outcomes.ts";

const ERRORS = { mean_px: 2, rms_px: 3 };
const MODEL: ModelSummary = {
  result_id: "1",
  status: "ok",
  message: "",
  polished: ERRORS,
  ga: ERRORS,
  baseline: null,
  linear_baseline: null,
  free_parameters: 10,
  at_bounds: [],
  lens: "fitted",
  stated_lens: null,
  pairs: 20,
  explained_px: null,
  marks_outside: null,
  iterations: 1,
  stopped: null,
  heldout_mean_px: null,
  heldout_rms_px: null,
  heldout_pairs: 0,
  heldout_forbidden: 0,
  heldout_sigma_px: null,
  weight: null,
  between_models: null,
  seconds: 1,
  workers: [],
  verdict: null,
  verdict_alone: null,
  behind: null,
};
const NOTHING_MORE = { why: "", checks: [], published: null };

test("an outcome says whether the error is of held-out pairs", () => {
  assert.equal(errorOf({ ...MODEL, heldout_mean_px: 1.5 }), "1.50 px held out");
  assert.equal(errorOf(MODEL), "2.00 px on fitted pairs, none held out");
  const cameras = {
    front: { recommended: "pinhole", models: { pinhole: MODEL }, ...NOTHING_MORE },
    left: { recommended: null, models: {}, ...NOTHING_MORE },
  };
  const said = outcomesOf({ cameras, rig: null }).map((one) => one.said);
  assert.deepEqual(said, ["front: pinhole 2.00 px on fitted pairs, none held out", "left: none"]);
  assert.deepEqual(outcomesOf(null), []);
});

test("an outcome that is not ok says so, however small its error", () => {
  const poor: ModelSummary = { ...MODEL, heldout_mean_px: 0, status: "not_determined", verdict: "stop" };
  const cameras = { front: { recommended: "pinhole", models: { pinhole: poor }, ...NOTHING_MORE } };
  assert.deepEqual(outcomesOf({ cameras, rig: null }), [
    { said: "front: pinhole 0.00 px held out", caution: "not determined, stop", doubtful: true },
  ]);
  assert.equal(caution("ok", "pass"), "");
  assert.equal(caution("ok", "look"), "look");
});

test("what holds for several cameras is said once", () => {
  const notes = ["front: a lens.", "The rig.", "left: a lens.", "left: other", "leftover: a lens."];
  assert.deepEqual(mergedNotes(notes, ["front", "left", "left"]), [
    "front, left: a lens.",
    "The rig.",
    "left: other",
    "leftover: a lens.",
  ]);
});
