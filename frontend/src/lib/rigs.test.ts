import assert from "node:assert/strict";
import { test } from "node:test";
import { newCamera, rigFromFile, rigRequest } from "./rigs.ts";

test("a drafted rig names both frames of every mount", () => {
  const draft = { name: " roof ", lidarFrame: "velodyne", lidarTopic: "", cameras: [newCamera("front")] };
  const rig = rigRequest(draft);
  assert.equal(rig.name, "roof");
  assert.equal(rig.lidar.topic, null);
  const camera = rig.cameras[0];
  assert.equal(camera?.nominal.from_frame, "velodyne");
  assert.equal(camera.nominal.to_frame, camera.frame);
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
