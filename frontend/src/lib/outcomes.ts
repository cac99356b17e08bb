/** What a calibration came to, in a line. */

import type { CheckVerdict } from "./api/types.ts";
import type { CameraSummary, ModelSummary, Summary } from "./api/schema.ts";
import { fixed, words } from "./format.ts";

export interface Outcome {
  said: string;
  /** What speaks against it; empty where nothing does. */
  caution: string;
  /** Whether its status is another than `ok`, or a check says stop. */
  doubtful: boolean;
}

/** Each camera's recommended model with its error. */
export function outcomesOf(summary: Summary | null): Outcome[] {
  return Object.entries(summary?.cameras ?? {}).map(([camera, found]) => {
    const chosen = recommended(found);
    return {
      said: `${camera}: ${found.recommended ?? "none"}${chosen ? ` ${errorOf(chosen)}` : ""}`,
      caution: caution(chosen?.status, chosen?.verdict),
      doubtful: isDoubtful(chosen?.status) || chosen?.verdict === "stop",
    };
  });
}

/** Whether the status is not `ok`; its errors then say little, however small. */
export const isDoubtful = (status: string | null | undefined): boolean => (status ?? "ok") !== "ok";

/** A status other than `ok`, and a verdict other than `pass`: "not determined, stop". */
export function caution(status: string | null | undefined, verdict: CheckVerdict | null | undefined): string {
  const parts = [
    ...(isDoubtful(status) ? [words(status ?? "")] : []),
    ...(verdict && verdict !== "pass" ? [verdict] : []),
  ];
  return parts.join(", ");
}

export const recommended = (found: CameraSummary): ModelSummary | undefined =>
  found.recommended ? found.models[found.recommended] : undefined;

/** The held-out error where pairs were held out; else that of the fitted ones. */
export function errorOf({ heldout_mean_px, polished }: ModelSummary): string {
  if (typeof heldout_mean_px === "number") return `${fixed(heldout_mean_px)} px held out`;
  return `${fixed(polished.mean_px)} px on fitted pairs, none held out`;
}

/** Notes that say the same of several cameras ("front: …", "left: …"), said once ("front, left: …"). */
export function mergedNotes(notes: readonly string[], cameras: readonly string[]): string[] {
  const of = new Map<string, string[]>();
  for (const note of notes) {
    const camera = cameras.find((name) => note.startsWith(`${name}: `));
    const said = camera === undefined ? note : note.slice(camera.length + 2);
    of.set(said, [...(of.get(said) ?? []), ...(camera === undefined ? [] : [camera])]);
  }
  return [...of].map(([said, names]) => (names.length > 0 ? `${names.join(", ")}: ${said}` : said));
}
