import assert from "node:assert/strict";
import { test } from "node:test";
import { concerns } from "./concerns.ts";

const says = (kind: string, id: string, ...address: unknown[]): boolean => concerns({ kind, id }, address);

test("a thing, what lies below it and the listings of such things are stale", () => {
  assert(says("fleet_request", "7", "fleet-requests", "7"));
  assert(says("fleet_request", "7", "fleet-requests", "7", "vehicles", { limit: 100 }));
  assert(says("fleet_request", "7", "fleets", "1", "fleet-requests", { limit: 50 }));
  assert(says("recording", "7", "recordings", { fleet_id: "1" }));
  assert(says("detection", "7", "recordings", "3", "detections"));
  assert(says("member", "7", "fleets", "1", "members"));
});

test("another thing of the kind, and things of another kind, are not", () => {
  assert(!says("calibration", "7", "calibrations", "8"));
  assert(!says("calibration", "7", "recordings", "8"));
  assert(!says("recording", "7", "recordings", "8", "detections"));
  assert(!says("detection", "7", "fleets", "1"));
});

test("what changes with a thing is stale as well", () => {
  assert(says("calibration", "7", "vehicles", "1", "cameras", "front", "calibration"));
  assert(says("calibration", "7", "vehicles", "1", "cameras", "front", "publications", { limit: 10 }));
  assert(says("detection", "7", "rigs", "1", "correspondence-sets"));
  assert(says("recording", "7", "fleets", "1"));
  assert(says("analysis", "7", "fleets", "1"));
  assert(says("analysis", "7", "analyses", { recording_id: "3" }));
  assert(says("recording", "7", "detections", "1", "progress", { camera: "front" }));
});

test("a hint of the fleet means everything", () => assert(says("fleet", "1", "results", "3")));
