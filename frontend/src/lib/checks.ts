/** The checks of a result, as pages show them. */

import type { Check, CheckVerdict } from "./api/types.ts";

/** What does not pass, the gravest first, what concerns the mount alone last. */
export function failing(checks: readonly Check[]): Check[] {
  const rank = (check: Check): number => (check.scope === "mount_alone" ? 2 : 0) + (check.verdict === "stop" ? 0 : 1);
  return checks.filter((check) => check.verdict !== "pass").toSorted((a, b) => rank(a) - rank(b));
}

/** What a verdict asks for. */
export const VERDICT_WORDS: Record<CheckVerdict, string> = {
  pass: "It passes its checks.",
  look: "Look at these checks before it is used.",
  stop: "It should not be used as it is.",
};
