/** Something that a person starts: busy while it runs, and its refusal kept to be shown where it was started. */

import { asProblem, type ApiProblem } from "./api/http.ts";
import { renew } from "./cache.svelte.ts";

export class Action {
  busy = $state(false);
  problem = $state.raw<ApiProblem | null>(null);

  /** Runs `work` unless it runs already. Returns what it gives, or undefined where it was refused. */
  async run<T>(work: () => Promise<T>): Promise<T | undefined> {
    if (this.busy) return undefined;
    this.busy = true;
    this.problem = null;
    try {
      return await work();
    } catch (error) {
      this.problem = asProblem(error);
      return undefined;
    } finally {
      this.busy = false;
    }
  }

  /** Runs `work` that changes something, and has all readings renewed: also after a refusal, which may tell of a change. */
  async change<T>(work: () => Promise<T>): Promise<T | undefined> {
    const made = await this.run(work);
    await renew();
    return made;
  }
}
