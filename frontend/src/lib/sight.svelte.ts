/** Whether a person can have seen the frame that is shown: a key or click from before meant the frame before. */

import { painted } from "./painted.ts";

/** Nobody reacts to a new picture faster (simple visual reaction time). */
const REACTION_MS = 200;

export class Sight {
  /** The frame is so new that nobody can have meant it yet. */
  isFresh = $state(false);
  /** From when on, in time stamps of events, it was seen. */
  from = Infinity;
  private frames = 0;

  /** Another frame is shown: waits until it is on the screen and could have been seen. */
  async begin(): Promise<void> {
    this.frames += 1;
    const number = this.frames;
    this.from = Infinity;
    this.isFresh = true;
    await painted();
    if (this.frames !== number) return;
    this.from = performance.now() + REACTION_MS;
    setTimeout(() => {
      if (this.frames === number) this.isFresh = false;
    }, REACTION_MS);
  }
}
