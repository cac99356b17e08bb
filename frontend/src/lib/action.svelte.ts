/** Something that a person starts: busy while it runs, and its refusal kept to be shown where it was started. */

import { asProblem, type ApiProblem } from "./api/http.ts";

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
}
