import assert from "node:assert/strict";
import { test } from "node:test";
import type { Check, MarkingPrecision, NextStep } from "./api/schema.ts";
import { failing, fitInWords, unchecked } from "./checks.ts";

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
    check("rig", "not_checked"),
    check("clock", "look"),
    check("lens", "stop"),
  ];
  assert.deepEqual(
    failing(checks).map((one) => one.name),
    ["lens", "clock", "alone"],
  );
  assert.deepEqual(
    unchecked(checks).map((one) => one.name),
    ["rig"],
  );
});

test("a fit says how good it is, and is enough if its checks pass", () => {
  const marks = {
    kind: "marks" as const,
    words: "12 more marks at the left edge",
    half_width_deg: 0.2,
    half_width_mm: 9,
  };
  const lens = { ...marks, kind: "lens" as const, words: "give a lens file" };
  const now = { half_width_deg: 0.31, half_width_mm: 14.4, parts: {} };
  const fit = { answered: 25, pairs: 24, error_20m_mm: 35.2, doubts: [] as Check[] };
  const of = (steps: NextStep[]): MarkingPrecision => ({ ...fit, next_steps: { ...now, steps } });
  assert.equal(
    fitInWords(of([lens, marks])),
    "From 24 pairs: 35 mm at 20 m; mount ±0.31°, ±14 mm (95 %). That is enough: it passes its checks. To know the mount better: give a lens file (±0.20°, ±9 mm); then 12 more marks at the left edge" +
      " (±0.20°, ±9 mm).",
  );
  const doubted = {
    ...of([lens]),
    doubts: [{ ...check("pairs", "stop"), sentence: "Too few.", remedy: "Mark more." }],
  };
  assert.match(fitInWords(doubted), /Not enough yet \(stop\): Too few\. Mark more\. Next: give/);
  assert.doesNotMatch(fitInWords({ ...doubted, ...{ next_steps: { ...now, steps: [] } } }), /is enough/);
  assert.match(fitInWords({ ...fit, next_steps: null }), /do not determine the mount yet\.$/);
});
