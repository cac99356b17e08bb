import assert from "node:assert/strict";
import { test } from "node:test";
import type { NewRig, RigOut } from "./api/schema.ts";
import { rigFromFile, sameRig } from "./rigs.ts";

test("the same mounts are the same rig, whatever its name and the order of members", () => {
  const nominal = { to_frame: "c", from_frame: "l", rotation: { matrix: [] }, translation_m: [0, 0, 1] };
  const camera = { name: "front", frame: "c", topic: null, image_size: [640, 480], nominal, bounds: {} };
  const rig = { name: "one", lidar: { frame: "l", topic: "/points" }, cameras: [camera], camera_transforms: [] };
  const same = { ...rig, name: "other", T_vehicle_lidar: null, cameras: [{ ...camera, joint: null, serial: "1" }] };
  assert.ok(sameRig(rig as unknown as NewRig, JSON.parse(JSON.stringify(same)) as RigOut));
  const rounded = { ...nominal, translation_m: [1e-17, -0, 1] };
  assert.ok(
    sameRig(rig as unknown as NewRig, { ...rig, cameras: [{ ...camera, nominal: rounded }] } as unknown as RigOut),
  );
  const moved = { ...camera, nominal: { ...nominal, translation_m: [0, 0, 2] } };
  assert.ok(!sameRig(rig as unknown as NewRig, { ...rig, cameras: [moved] } as unknown as RigOut));
});

test("a rig file goes to the service as it is, with a name where it has none", () => {
  const file = { lidar: { frame: "velodyne" }, cameras: [{ name: "front" }] };
  assert.deepEqual(rigFromFile(JSON.stringify(file), "roof"), { name: "roof", ...file });
  assert.equal(rigFromFile(JSON.stringify({ ...file, name: "own" }), "roof").name, "own");
});

test("a file that is no rig is told so", () => {
  for (const text of ['{"lidar": {"frame": "velodyne"}}', '{"cameras": []}', "[]"]) {
    assert.throws(() => rigFromFile(text, "x"), /rig file/);
  }
});
