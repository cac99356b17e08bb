import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { test } from "node:test";
import { base64, hex } from "./digests.ts";

test("hexadecimal and base64 are as the service takes them", () => {
  const digest = createHash("sha256").update("apexcal");
  assert.equal(hex(digest.copy().digest()), digest.copy().digest("hex"));
  assert.equal(base64(digest.copy().digest()), digest.digest("base64"));
});
