/** Which readings a hint makes stale. */

import type { Hint } from "./hints.ts";

/** What changes with a thing, beside the thing itself, what lies below it and the listings of such things. */
const ALSO: Record<string, readonly string[]> = {
  analysis: ["analyses", "crops", "marking-work"],
  calibration: ["calibration", "publications", "drift", "health"],
  detection: ["correspondence-sets", "marking-work"],
  marking: ["progress"],
  recording: ["progress", "health"],
  rig: ["health"],
  vehicle: ["health"],
};

/** Whether what was read at `address`, segment by segment, may be another since the hint. */
export function concerns({ kind, id }: Hint, address: readonly unknown[]): boolean {
  // `fleet`: anything of the fleet may have changed.
  if (kind === "fleet") return true;
  const things = `${kind.replaceAll("_", "-")}s`;
  const segments = address.filter((one) => typeof one === "string");
  const at = segments.indexOf(things);
  if (at >= 0) return at === segments.length - 1 || segments[at + 1] === id;
  // The fleet says how many bytes its recordings and reports take.
  if (["analysis", "recording"].includes(kind) && segments[0] === "fleets" && segments.length === 2) return true;
  return (ALSO[kind] ?? []).includes(segments.at(-1) ?? "");
}
