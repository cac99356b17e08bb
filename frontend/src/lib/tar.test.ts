import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { tarOf } from "./tar.ts";

test("tar unpacks what was packed, whatever its size and the length of its name", async () => {
  const long = `${"folder/".repeat(15)}${"x".repeat(90)}.pcd`;
  const contents = new Map([
    ["walk/b.db3-wal", "log".repeat(400)],
    ["walk/a.db3", "x".repeat(512)],
    ["walk/empty", ""],
    [long, "ö"],
  ]);
  const entries = [...contents].map(([path, text]) => ({ path, file: new Blob([text]) }));
  const packed = tarOf(entries, "walk");
  assert.equal(packed.name, "walk.tar");
  assert.deepEqual(await packed.bytes(), await tarOf(entries.reverse(), "walk").bytes());
  const path = join(mkdtempSync(join(tmpdir(), "tar-")), "walk.tar");
  writeFileSync(path, await packed.bytes());
  const listed = spawnSync("tar", ["tf", path], { encoding: "utf8" });
  assert.equal(listed.stdout, [...contents.keys()].sort().join("\n") + "\n");
  for (const [name, text] of contents) {
    assert.equal(spawnSync("tar", ["xOf", path, name], { encoding: "utf8" }).stdout, text);
  }
});

test("a name that a tar cannot hold is refused in words", () => {
  assert.throws(() => tarOf([{ path: "y".repeat(101), file: new Blob([]) }], "walk"), /too long/);
});
