import assert from "node:assert/strict";
import { test } from "node:test";
import type { Check, MarkingPrecision, NextStep } from "./api/schema.ts";
import { failing, fitInWords } from "./checks.ts";

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

test("a fit says how good it is, and how many marks are enough", () => {
  const marks = {
    kind: "marks" as const,
    words: "mark 12 more at the left edge",
    half_width_deg: 0.2,
    half_width_mm: 9,
  };
  const lens = { ...marks, kind: "lens" as const, words: "give a lens file" };
  const now = { half_width_deg: 0.31, half_width_mm: 14.4, parts: {} };
  const fit = { answered: 25, pairs: 24, error_20m_mm: 35.2 };
  const of = (steps: NextStep[]): MarkingPrecision => ({ ...fit, next_steps: { ...now, steps } });
  assert.equal(
    fitInWords(of([lens, marks])),
    "From 24 pairs: 35 mm at 20 m; mount ±0.31°, ±14 mm (95 %). Next: give a lens file (±0.20°, ±9 mm); then mark 12 more at the left edge" +
      " (±0.20°, ±9 mm). 12 more marks are enough.",
  );
  assert.match(fitInWords(of([lens])), /More marks narrow it little\.$/);
  assert.match(fitInWords(of([])), /More marks will not help/);
  assert.match(fitInWords({ ...fit, next_steps: null }), /do not determine the mount yet\.$/);
});
