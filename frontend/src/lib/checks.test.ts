import assert from "node:assert/strict";
import { test } from "node:test";
import type { Check } from "./api/schema.ts";
import { failing } from "./checks.ts";

const check = (name: string, verdict: Check["verdict"], scope: Check["scope"] = "mount_with_lens"): Check => ({
  name,
  title: name,
  verdict,
  sentence: "",
  remedy: "",
  figures: {},
  scope,
});

test("what does not pass, the gravest first, the mount alone last", () => {
  const checks = [
    check("alone", "stop", "mount_alone"),
    check("fit", "pass"),
    check("clock", "look"),
    check("lens", "stop"),
  ];
  assert.deepEqual(
    failing(checks).map((one) => one.name),
    ["lens", "clock", "alone"],
  );
});
