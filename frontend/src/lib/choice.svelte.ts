/** Pairs, by number, that are chosen in all plots at once, and those that the next fit is to leave out. */

import { SvelteSet } from "svelte/reactivity";

export class Choice {
  readonly chosen = new SvelteSet<number>();
  readonly leftOut = new SvelteSet<number>();

  constructor(leftOut: Iterable<number> = []) {
    for (const pair of leftOut) this.leftOut.add(pair);
  }

  /** Chooses these pairs, beside those chosen before if `adding`; one of them alone is then chosen or freed. */
  choose(pairs: readonly number[], adding = false): void {
    if (!adding) this.chosen.clear();
    const [first] = pairs;
    if (adding && pairs.length === 1 && first !== undefined && this.chosen.delete(first)) return;
    for (const pair of pairs) this.chosen.add(pair);
  }

  leaveOut(pairs: Iterable<number> = this.chosen): void {
    for (const pair of pairs) this.leftOut.add(pair);
    this.chosen.clear();
  }

  clear(): void {
    this.chosen.clear();
    this.leftOut.clear();
  }
}
