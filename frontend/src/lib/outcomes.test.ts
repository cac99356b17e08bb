import assert from "node:assert/strict";
import { test } from "node:test";
import { errorOf, mergedNotes, outcomeOf } from "./outcomes.ts";

test("an outcome says whether the error is of held-out pairs", () => {
  assert.equal(errorOf({ result_id: "1", heldout_mean_px: 1.5 }), "1.50 px held out");
  const fitted = { result_id: "1", heldout_mean_px: null, polished: { mean_px: 2, rms_px: 3 } };
  assert.equal(errorOf(fitted), "2.00 px on fitted pairs, none held out");
  const cameras = {
    front: { recommended: "pinhole", why: "", models: { pinhole: fitted } },
    left: { recommended: null, why: "", models: {} },
  };
  assert.equal(outcomeOf({ cameras }), "front: pinhole 2.00 px on fitted pairs, none held out; left: none");
  assert.equal(outcomeOf(null), "");
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
