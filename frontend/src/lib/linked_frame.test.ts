import assert from "node:assert/strict";
import { test } from "node:test";
import { linkedFrame } from "./linked_frame.ts";

const front = { name: "front", count: 100 };
const linked = (query: string) => linkedFrame(new URLSearchParams(query), front);

test("a frame of this camera, with its mark", () => {
  assert.deepEqual(linked("camera=front&frame=12&u=3.5&v=4"), { index: 12, mark: { u: 3.5, v: 4 } });
  assert.deepEqual(linked("camera=front&frame=0"), { index: 0, mark: null });
});

test("past the end is the last one", () => {
  assert.equal(linked("camera=front&frame=400")?.index, 99);
});

test("another camera, or no frame", () => {
  for (const query of ["", "camera=left&frame=1", "camera=front", "camera=front&frame=-1", "camera=front&frame=x"]) {
    assert.equal(linked(query), null);
  }
});
