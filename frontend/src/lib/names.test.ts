import assert from "node:assert/strict";
import { test } from "node:test";
import { named } from "./names.ts";

const names = (part: string) =>
  named([{ name: "Van 10" }, { name: "Bus" }, { name: "van 2" }], part).map((one) => one.name);

test("by a part of the name, in the order of people", () => {
  assert.deepEqual(names(""), ["Bus", "van 2", "Van 10"]);
  assert.deepEqual(names(" VAN "), ["van 2", "Van 10"]);
  assert.deepEqual(names("tram"), []);
});
