import assert from "node:assert/strict";
import { test } from "node:test";
import { ApiProblem } from "./api/http.ts";
import type { Counts, DryRunView } from "./api/schema.ts";
import {
  countsInWords,
  dryRunInWords,
  filterInWords,
  filterOf,
  newFilter,
  outcomeInWords,
  partOf,
  publishedInWords,
} from "./fleet_requests.ts";

const counts = (some: Partial<Counts>): Counts => ({
  ...{ matched: 0, queued: 0, running: 0, done: 0, failed: 0, cancelled: 0, skipped: 0 },
  ...some,
});
const found = (some: Partial<DryRunView>): DryRunView => ({
  ...{ matched: 0, calibrations: 0, runs: 0, processor_seconds: 0, skipped: 0, reasons: [], skipped_vehicles: [] },
  ...some,
});

test("an empty filter names all vehicles, and only what was filled in is asked", () => {
  assert.deepEqual(filterOf(newFilter()), {});
  const draft = { ...newFilter(), name: " Truck * ", rig: "  ", newPairs: true, picked: ["a"] };
  assert.deepEqual(filterOf(draft), { vehicle_ids: ["a"], name: "Truck *", new_pairs: true });
});

test("a moment without a zone is the reader's own", () => {
  const { not_calibrated_since: since } = filterOf({ ...newFilter(), since: "2026-11-01T08:30" });
  assert.equal(since, new Date(2026, 10, 1, 8, 30).toISOString());
  assert.deepEqual(filterOf({ ...newFilter(), since: "no moment" }), {});
});

test("a filter in words", () => {
  assert.equal(filterInWords({ name: null, rig: null, named: null, new_pairs: false }), "all vehicles");
  assert.equal(filterInWords({ name: "Truck *", rig: "roof" }), "vehicles named Truck *, with a rig roof");
  assert.equal(
    filterInWords({ named: 2, new_pairs: true }),
    "2 vehicles picked by hand, with newer pairs than published",
  );
});

test("counts name the states that somebody is in", () => {
  assert.equal(countsInWords(counts({ matched: 9, done: 6, failed: 1, skipped: 2 })), "6 done, 1 failed, 2 skipped");
  assert.equal(countsInWords(counts({})), "no vehicle was due");
  assert.equal(publishedInWords({ published: 0, counts: counts({ done: 4 }) }), "published for 0 of 4");
  assert.equal(publishedInWords({ published: null, counts: counts({ done: 4 }) }), "");
});

test("a dry run in a sentence", () => {
  assert.equal(
    dryRunInWords(found({ matched: 1300, calibrations: 1299, runs: 2598, processor_seconds: 9000, skipped: 1 })),
    "1,300 vehicles match: 1,299 would be calibrated in 2,598 runs (at most 2.5 processor hours); 1 would be skipped.",
  );
  assert.match(
    dryRunInWords(found({ matched: 1, calibrations: 1, runs: 1, processor_seconds: 2 })),
    /in 1 run \(at most 1 processor minute\)\.$/,
  );
  assert.equal(
    dryRunInWords(found({ matched: 1, skipped: 1 })),
    "1 vehicle matches: 0 would be calibrated; 1 would be skipped.",
  );
  assert.match(dryRunInWords(found({})), /^No vehicle is due/);
});

test("a camera's outcome", () => {
  const sound = { status: "ok", verdict: "pass" as const, checks: [], published: true };
  const outcome = { model: "pinhole", mean_px: 1.2, heldout_mean_px: 1.345, ...sound };
  assert.equal(outcomeInWords("front", outcome), "front: pinhole, 1.34 px held out, published");
  const poor = { ...outcome, heldout_mean_px: null, published: false };
  assert.equal(outcomeInWords("front", poor), "front: pinhole, 1.20 px on fitted pairs");
  assert.equal(outcomeInWords("left", { ...poor, model: null }), "left: no model recommended");
});

test("a refusal stands at the part of the form that it is about", () => {
  const part = (status: number, code: string, field?: string) =>
    partOf(new ApiProblem(status, { code, ...(field ? { errors: [{ field, message: "is not valid" }] } : {}) }));
  assert.equal(part(422, "no_vehicle_matches"), "vehicles");
  assert.equal(part(422, "invalid_request", "vehicles.name"), "vehicles");
  assert.equal(part(422, "invalid_request", "calibration.folds"), "calibration");
  assert.equal(part(422, "unknown_parameter"), "calibration");
  assert.equal(part(422, "fleet_request_too_large"), "request");
  assert.equal(part(409, "conflict"), "request");
  assert.equal(part(0, "unreachable"), "request");
});
