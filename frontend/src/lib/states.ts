/** States as pages show them: each by a shape, a word and a colour, so that no colour alone tells it. */

import type { CameraState } from "./api/schema.ts";

export interface Look {
  shape: string;
  word: string;
  tone: "good" | "caution" | "bad" | "muted";
}

/** Of cameras, in the order of the tiles. */
export const CAMERA_STATES: Record<CameraState, Look> = {
  published: { shape: "●", word: "published", tone: "good" },
  look: { shape: "▲", word: "to look at", tone: "caution" },
  none: { shape: "○", word: "none", tone: "muted" },
  withdrawn: { shape: "✕", word: "withdrawn", tone: "bad" },
  sensor_swapped: { shape: "◆", word: "sensor swapped", tone: "bad" },
  unknown: { shape: "?", word: "unknown", tone: "caution" },
};

const SHAPES = { good: "●", caution: "▲", bad: "✕", muted: "○" } as const;
const TONES: Record<string, Look["tone"]> = {
  ready: "good",
  done: "good",
  done_with_failures: "caution",
  failed: "bad",
};

/** Of a recording, job, calibration or fleet request; `doubtful`: done, but with something to look at. */
export function lookOf(state: string, doubtful = false): Look {
  const tone = doubtful && TONES[state] === "good" ? "caution" : (TONES[state] ?? "muted");
  return { shape: SHAPES[tone], word: state.replaceAll("_", " "), tone };
}
