/** Sweeps fetched and unpacked; the last ones are kept. */

import { bytesAt } from "../api/blobs.ts";
import { keepRecent } from "../recent.ts";
import { unpack, type Sweep } from "./sweep.ts";

/** Sweeps kept, of all recordings together; one of 100,000 points takes 3 MB. */
const KEPT = 40;

/** The sweep at an address; two requests fetch it once. */
export const loadSweep = keepRecent(KEPT, load);

async function load(url: string): Promise<Sweep> {
  return unpack(new Uint8Array(await (await bytesAt(url)).arrayBuffer()));
}

/** The most points that are shown at once. */
export const MOST_POINTS = 300_000;
/** The most sweeps that are fetched to be shown at once. */
const MOST_SWEEPS = 30;

/** Numbers of sweeps spread evenly over a recording, as many as may be shown at once. */
export function spreadOver(sweeps: readonly { index: number; points: number }[]): number[] {
  const largest = sweeps.reduce((most, sweep) => Math.max(most, sweep.points), 1);
  const count = Math.min(sweeps.length, MOST_SWEEPS, Math.max(1, Math.floor(MOST_POINTS / largest)));
  return Array.from({ length: count }, (_, i) => sweeps[Math.floor(((i + 0.5) * sweeps.length) / count)]?.index ?? 0);
}
