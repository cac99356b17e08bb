import assert from "node:assert/strict";
import { test } from "node:test";
import type { ModelSummary } from "./api/types.ts";
import { caution, errorOf, mergedNotes, outcomesOf } from "./outcomes.ts";

const MODEL: ModelSummary = { result_id: "1", status: "ok", message: "", polished: null };

test("an outcome says whether the error is of held-out pairs", () => {
  assert.equal(errorOf({ ...MODEL, heldout_mean_px: 1.5 }), "1.50 px held out");
  const fitted = { ...MODEL, heldout_mean_px: null, polished: { mean_px: 2, rms_px: 3 } };
  assert.equal(errorOf(fitted), "2.00 px on fitted pairs, none held out");
  const cameras = {
    front: { recommended: "pinhole", why: "", models: { pinhole: fitted } },
    left: { recommended: null, why: "", models: {} },
  };
  const said = outcomesOf({ cameras }).map((one) => one.said);
  assert.deepEqual(said, ["front: pinhole 2.00 px on fitted pairs, none held out", "left: none"]);
  assert.deepEqual(outcomesOf(null), []);
});

test("an outcome that is not ok says so, however small its error", () => {
  const poor: ModelSummary = { ...MODEL, heldout_mean_px: 0, status: "not_determined", verdict: "stop" };
  const cameras = { front: { recommended: "pinhole", why: "", models: { pinhole: poor } } };
  assert.deepEqual(outcomesOf({ cameras }), [
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
