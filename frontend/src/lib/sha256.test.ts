import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { test } from "node:test";
import { base64, hex, sha256, sha256Plain } from "./sha256.ts";

test("the plain form agrees with the platform's at every padding length", () => {
  for (const length of [0, 1, 55, 56, 57, 63, 64, 65, 119, 120, 1000]) {
    const bytes = Uint8Array.from({ length }, (_, i) => (i * 37 + length) % 256);
    assert.equal(hex(sha256Plain(bytes)), createHash("sha256").update(bytes).digest("hex"), `${length} bytes`);
  }
});

test("a view into a larger buffer is hashed by itself", () => {
  const view = new Uint8Array(200).fill(7).subarray(30, 130);
  assert.equal(hex(sha256Plain(view)), createHash("sha256").update(view).digest("hex"));
});

test("base64 is what Content-Digest carries", async () => {
  const digest = await sha256(new TextEncoder().encode("apexcal").buffer as ArrayBuffer);
  assert.equal(base64(digest), createHash("sha256").update("apexcal").digest("base64"));
});
