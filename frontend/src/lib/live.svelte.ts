/** A reading of the service's state that a page shows and keeps fresh. */

import { untrack } from "svelte";
import { asProblem, type ApiProblem } from "./api/http.ts";
import { onHint, type Hint } from "./hints.ts";

export interface Freshness<T> {
  /** What the reading is of, where that can change while the component lives: another key is another reading. */
  key?: () => string | number | null;
  /** The fleet whose hints to follow, once it is known. */
  fleet?: (value: T | undefined) => string | undefined;
  /** Which hints mean that this reading is stale; all of them where absent. */
  concerns?: (hint: Hint) => boolean;
  /** Whether work is under way, so that progress is worth asking for every two seconds. */
  busy?: (value: T | undefined) => boolean;
}

const POLL_MS = 2000;
const SETTLE_MS = 150;
const APART_MS = 1000;

export class Live<T> {
  value = $state.raw<T | undefined>(undefined);
  problem = $state.raw<ApiProblem | null>(null);
  private latest = 0;
  private readonly read: () => Promise<T>;

  /**
   * Create it while a component is initialised: it reads at once, and again when its key changes. What `read` uses
   * is not followed: properties of a component are new with every reading of its parent, though they are equal.
   */
  constructor(read: () => Promise<T>, freshness: Freshness<T> = {}) {
    this.read = read;
    const key = $derived(freshness.key?.() ?? null);
    $effect(() => {
      void key;
      this.value = undefined;
      untrack(() => void this.reload());
    });
    const fleet = $derived(freshness.fleet?.(this.value));
    $effect(() => (fleet ? this.follow(fleet, freshness.concerns ?? (() => true)) : undefined));
    const busy = $derived(freshness.busy?.(this.value) ?? false);
    $effect(() => {
      if (!busy) return undefined;
      const timer = setInterval(() => document.visibilityState === "visible" && void this.reload(), POLL_MS);
      return () => clearInterval(timer);
    });
  }

  /** Reads again; an answer that was overtaken by a later question is dropped. */
  readonly reload = async (): Promise<void> => {
    const turn = ++this.latest;
    try {
      const value = await this.read();
      if (turn !== this.latest) return;
      this.value = value;
      this.problem = null;
    } catch (error) {
      if (turn === this.latest) this.problem = asProblem(error);
    }
  };

  /** Soon after a hint, but not with each: while a fleet is calibrated they come many a second. */
  private follow(fleetId: string, concerns: (hint: Hint) => boolean): () => void {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let last = -Infinity;
    const read = (): void => {
      timer = undefined;
      last = performance.now();
      void this.reload();
    };
    const stop = onHint(fleetId, (hint) => {
      if (timer !== undefined || (hint.kind !== "" && !concerns(hint))) return;
      timer = setTimeout(read, Math.max(SETTLE_MS, last + APART_MS - performance.now()));
    });
    return () => {
      clearTimeout(timer);
      stop();
    };
  }
}
