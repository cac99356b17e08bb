/** The checks of a result, as pages show them. */

import type { CheckVerdict } from "./api/types.ts";
import type { CameraSummary, Check, MarkingPrecision, ResultView } from "./api/schema.ts";
import { counted, fixed } from "./format.ts";

/** What does not pass, the gravest first, what concerns the mount alone last. */
export function failing(checks: readonly Check[]): Check[] {
  const rank = (check: Check): number => (check.scope === "mount_alone" ? 2 : 0) + (check.verdict === "stop" ? 0 : 1);
  const isDoubt = ({ verdict }: Check): boolean => verdict === "look" || verdict === "stop";
  return checks.filter(isDoubt).toSorted((a, b) => rank(a) - rank(b));
}

/** The checks that were not made: they speak neither for the result nor against it. */
export const unchecked = (checks: readonly Check[]): Check[] =>
  checks.filter(({ verdict }) => verdict === "not_checked");

/**
 * Marks that let the check of pairs pass: 50 degrees of freedom beside the 16 parameters of the largest model, two
 * coordinates a mark (docs/checks.md).
 */
export const ENOUGH_MARKS = 33;

/** How good a fit is by what it states, and what would narrow it: the marks that are worth making, and where. */
export function fitInWords({ pairs, error_20m_mm, doubts, next_steps }: MarkingPrecision): string {
  const size = (deg: number, mm: number): string => `±${fixed(deg)}°, ±${fixed(mm, 0)} mm`;
  const far = error_20m_mm == null ? "" : ` ${fixed(error_20m_mm, 0)} mm at 20 m;`;
  if (!next_steps) return `${counted(pairs, "pair")} do not determine the mount yet.`;
  const { half_width_deg, half_width_mm, steps } = next_steps;
  const now = `From ${counted(pairs, "pair")}:${far} mount ${size(half_width_deg, half_width_mm)} (95 %).`;
  const [gravest] = doubts;
  const judged = gravest
    ? ` Not enough yet (${gravest.verdict}): ${gravest.sentence} ${gravest.remedy}`
    : " That is enough: it passes its checks.";
  if (steps.length === 0) return `${now}${judged}${gravest ? " More marks narrow the mount by less than 5 %." : ""}`;
  const ways = steps.map((step) => `${step.words} (${size(step.half_width_deg, step.half_width_mm)})`);
  return `${now}${judged} ${gravest ? "Next" : "To know the mount better"}: ${ways.join("; then ")}.`;
}

/** What a verdict asks for. */
export const VERDICT_WORDS: Record<CheckVerdict, string> = {
  pass: "It passes its checks.",
  look: "Look at these checks before it is used.",
  stop: "It should not be used as it is.",
};

/** What a result's verdict asks for, and how far it errs: held out if pairs were, and at 20 m in the image's middle. */
export function verdictLine(
  { verdict, model, polished, prediction }: ResultView,
  summary: CameraSummary | null,
): string {
  const heldOut = summary?.models[model]?.heldout_mean_px;
  const off = heldOut == null ? `${fixed(polished.mean_px)} px on the fitted pairs` : `${fixed(heldOut)} px held out`;
  const middle = prediction?.points[Math.floor(prediction.points.length / 2)];
  const mm = middle?.stated_mm?.[prediction?.distances_m.indexOf(20) ?? -1];
  const far = mm == null ? "" : `, ${fixed(mm * (prediction?.expected_over_stated ?? 1), 0)} mm at 20 m`;
  return `${VERDICT_WORDS[verdict ?? "stop"]} ${off}${far}.`;
}
