/** What was loaded last of what a component wants now: an answer that comes after the wish changed is dropped. */

import { asProblem, type ApiProblem } from "./api/http.ts";

/** A component makes it, and it lives as long as the component. */
export class Latest<Wanted, Loaded> {
  /** The newest that has come, also while the next one is loaded. */
  value = $state.raw<Loaded | null>(null);
  problem = $state.raw<ApiProblem | null>(null);
  /** Whether value or problem is of what is wanted now. */
  settled = $state(false);
  private turn = $state(0);

  /**
   * `wanted` is followed; nothing is loaded while it is null. With `restMs` it is loaded once the wish has rested so
   * long, and one after the other.
   */
  constructor(wanted: () => Wanted | null | undefined, load: (wanted: Wanted) => Promise<Loaded>, restMs = 0) {
    let before: Promise<void> | undefined;
    $effect(() => {
      const asked = wanted();
      void this.turn;
      this.settled = false;
      if (asked === null || asked === undefined) return undefined;
      let late = false;
      const isLate = (): boolean => late;
      const begin = async (): Promise<void> => {
        if (before) await before;
        if (isLate()) return;
        try {
          const loaded = await load(asked);
          if (!isLate()) [this.value, this.problem, this.settled] = [loaded, null, true];
        } catch (error) {
          if (!isLate()) [this.problem, this.settled] = [asProblem(error), true];
        }
      };
      const timer = restMs > 0 ? setTimeout(() => void (before = begin()), restMs) : void begin();
      return () => {
        late = true;
        clearTimeout(timer ?? undefined);
      };
    });
  }

  /** Loads once more, though nothing changed. */
  readonly retry = (): void => void (this.turn += 1);
}
