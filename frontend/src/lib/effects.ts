/** Before something is done: which answers of cars it would change. */

import type { Sending } from "./api/writes.ts";

/** Does the work once a person agrees to the question and to what cars will get; whether they do. */
export async function agreed(work: (sending?: Sending) => Promise<unknown>, question = ""): Promise<boolean> {
  const { effects } = (await work({ headers: { "Dry-Run": "true" } })) as { effects: string[] };
  const said =
    effects.length === 0 ? question : `Cars will get other answers:\n${effects.join("\n")}\n\n${question || "Go on?"}`;
  if (said !== "" && !confirm(said)) return false;
  await work();
  return true;
}
