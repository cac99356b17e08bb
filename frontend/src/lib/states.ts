/** States as pages show them: each by a shape, a word and a colour, so that no colour alone tells it. */

import type { CameraHealth, CameraState, CameraWork } from "./api/schema.ts";

export interface Look {
  shape: string;
  word: string;
  tone: "good" | "caution" | "bad" | "muted";
}

/** What cars get for a camera, in the order of the tiles. */
export const CAMERA_STATES: Record<CameraState, Look> = {
  published: { shape: "●", word: "published", tone: "good" },
  none: { shape: "○", word: "none", tone: "muted" },
  withdrawn: { shape: "✕", word: "withdrawn", tone: "bad" },
};

/** What a camera waits for, in the order of the tiles. */
export const CAMERA_WORK: Record<CameraWork, string> = {
  decision: "a decision",
  running: "running",
  marks: "marks",
  recording: "a recording",
  nothing: "nothing",
};

/** What a car gets for a camera, with what its checks say today: a doubt is never green. */
export function cameraLook({ state, verdict, is_swapped }: CameraHealth): Look {
  if (!state) return { shape: "", word: "no camera", tone: "muted" };
  const look = CAMERA_STATES[state];
  if (state !== "published") return look;
  if (is_swapped) return { shape: "◆", word: "published, sensor swapped", tone: "bad" };
  if (verdict === "pass") return look;
  const word = verdict ? `published, check: ${verdict}` : "published, not checked";
  return verdict === "stop" ? { shape: "✕", word, tone: "bad" } : { shape: "▲", word, tone: "caution" };
}

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
