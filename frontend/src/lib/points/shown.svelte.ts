/** Which of a recording's sweeps are shown, and their points. */

import type { ApiProblem } from "../api/http.ts";
import * as recordings from "../api/recordings.ts";
import type { SweepView } from "../api/schema.ts";
import { reading } from "../cache.svelte.ts";
import { Latest } from "../latest.svelte.ts";
import { cloudOf, type Cloud } from "./cloud.ts";
import { loadSweep, spreadOver } from "./load.ts";

/** A component makes it, and it lives as long as the component. */
export class ShownSweeps {
  /** The place in the list of the one sweep that is shown. */
  number = $state(0);
  /** Many at once, spread over the recording. */
  together = $state(false);
  readonly #found: { data: SweepView[] | undefined; error: ApiProblem | null };
  readonly #loaded: Latest<number[], Cloud>;
  readonly sweeps = $derived.by(() => this.#found.data ?? []);
  readonly at = $derived(this.sweeps[this.number]);
  readonly last = $derived(Math.max(0, this.sweeps.length - 1));
  readonly wanted = $derived(this.together ? spreadOver(this.sweeps) : this.at ? [this.at.index] : []);
  readonly label = $derived(
    this.together ? `${this.wanted.length} sweeps, spread over the recording` : `Sweep ${this.at?.index ?? 0}`,
  );

  constructor(recordingId: () => string) {
    this.#found = reading(() => recordings.sweeps(recordingId()));
    const url = (index: number): string => recordings.sweepUrl(recordingId(), index);
    this.#loaded = new Latest(
      () => (this.wanted.length > 0 ? this.wanted : null),
      async (wanted) => {
        const next = this.together ? undefined : this.sweeps[this.number + 1];
        const loaded = await Promise.all(wanted.map(async (index) => ({ ...(await loadSweep(url(index))), index })));
        if (next) loadSweep(url(next.index)).catch(() => undefined);
        return cloudOf(loaded);
      },
    );
  }

  get problem(): ApiProblem | null {
    return this.#found.error ?? this.#loaded.problem;
  }

  get cloud(): Cloud | null {
    return this.#loaded.value;
  }
}
