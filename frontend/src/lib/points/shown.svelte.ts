/** Which of a recording's sweeps are shown, and their points. */

import { asProblem, type ApiProblem } from "../api/http.ts";
import * as recordings from "../api/recordings.ts";
import type { SweepPlace } from "../api/types.ts";
import { reading } from "../cache.svelte.ts";
import { stepped } from "../stepping.ts";
import { cloudOf, type Cloud } from "./cloud.ts";
import { loadSweep, spreadOver } from "./load.ts";

/** A component makes it, and it lives as long as the component. */
export class ShownSweeps {
  /** The place in the list of the one sweep that is shown. */
  number = $state(0);
  /** Many at once, spread over the recording. */
  together = $state(false);
  cloud = $state.raw<Cloud | null>(null);
  readonly #found: { data: SweepPlace[] | undefined; error: ApiProblem | null };
  #problem = $state.raw<ApiProblem | null>(null);
  readonly sweeps = $derived.by(() => this.#found.data ?? []);
  readonly at = $derived(this.sweeps[this.number]);
  readonly last = $derived(Math.max(0, this.sweeps.length - 1));
  readonly wanted = $derived(this.together ? spreadOver(this.sweeps) : this.at ? [this.at.index] : []);
  readonly label = $derived(
    this.together ? `${this.wanted.length} sweeps, spread over the recording` : `Sweep ${this.at?.index ?? 0}`,
  );

  constructor(recordingId: () => string) {
    this.#found = reading(() => recordings.sweeps(recordingId()));
    $effect(() => this.#load(recordingId(), this.wanted));
  }

  get isPacked(): boolean {
    return this.#found.error?.code !== "not_packed";
  }

  get problem(): ApiProblem | null {
    return this.#found.error ?? this.#problem;
  }

  #load(recordingId: string, wanted: number[]): void {
    if (wanted.length === 0) return;
    const url = (index: number): string => recordings.sweepUrl(recordingId, index);
    Promise.all(wanted.map((index) => loadSweep(url(index))))
      .then((loaded) => {
        if (wanted !== this.wanted) return;
        this.cloud = cloudOf(loaded);
        this.#problem = null;
        const next = this.together ? undefined : this.sweeps[this.number + 1];
        if (next) loadSweep(url(next.index)).catch(() => undefined);
      })
      .catch((error: unknown) => {
        if (wanted === this.wanted) this.#problem = asProblem(error);
      });
  }

  step(event: KeyboardEvent): void {
    this.number = stepped(event, this.number, this.last);
  }
}
