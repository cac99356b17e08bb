/** What was loaded last of what a component wants now: an answer that comes after the wish changed is dropped. */

import { asProblem, type ApiProblem } from "./api/http.ts";

/** A component makes it, and it lives as long as the component. */
export class Latest<Wanted, Loaded> {
  /** The newest that has come, also while the next one is loaded. */
  value = $state.raw<Loaded | null>(null);
  problem = $state.raw<ApiProblem | null>(null);

  /** `wanted` is followed; nothing is loaded while it is null. */
  constructor(wanted: () => Wanted | null | undefined, load: (wanted: Wanted) => Promise<Loaded>) {
    $effect(() => {
      const asked = wanted();
      if (asked === null || asked === undefined) return undefined;
      let isLate = false;
      load(asked)
        .then((loaded) => {
          if (!isLate) [this.value, this.problem] = [loaded, null];
        })
        .catch((error: unknown) => {
          if (!isLate) this.problem = asProblem(error);
        });
      return () => (isLate = true);
    });
  }
}
