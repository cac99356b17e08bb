/** What the pages have read from the service: kept by address, shared by all components, renewed when a hint says so. */

import { createQuery, QueryClient, type CreateQueryResult } from "@tanstack/svelte-query";
import type { ApiProblem } from "./api/http.ts";
import type { Read } from "./api/reads.ts";
import { concerns } from "./concerns.ts";
import { onHint, type Hint } from "./hints.ts";

const SETTLE_MS = 150;
const APART_MS = 1000;

export const cache = new QueryClient({
  defaultOptions: {
    queries: {
      // `send` repeats what broke; a refusal stays one. Hints say what is stale, also after the page was hidden.
      retry: false,
      staleTime: 2000,
      refetchOnWindowFocus: false,
      refetchOnReconnect: false,
      // A service on this machine needs no network.
      networkMode: "always",
      // Else a property that is first read after its last change keeps the value that it had before.
      notifyOnChangeProps: "all",
    },
  },
});

/** A reading that a component shows: `data` once it is there, `error` while it is refused. */
export function reading<T>(options: () => Read<T>): CreateQueryResult<T, ApiProblem> {
  return createQuery<T, ApiProblem>(options, () => cache);
}

/** Reads again what is shown, and later what else was read: the person has changed something. */
export const renew = (): Promise<void> => cache.invalidateQueries();

/** Follows the hints of a fleet while the component lives. */
export function follow(fleetId: () => string | undefined): void {
  const followed = $derived(fleetId());
  $effect(() => (followed ? onHint(followed, note) : undefined));
}

let noted: Hint[] = [];
let timer: ReturnType<typeof setTimeout> | undefined;
let last = -Infinity;

/**
 * Reads again soon after a hint, but not after each: while a fleet is calibrated they come many a second. Pages that
 * hear the same hint do not all read in the same moment.
 */
function note(hint: Hint): void {
  noted.push(hint);
  const settle = SETTLE_MS + (APART_MS - SETTLE_MS) * Math.random();
  timer ??= setTimeout(flush, Math.max(settle, last + APART_MS - performance.now()));
}

function flush(): void {
  const hints = noted;
  noted = [];
  timer = undefined;
  last = performance.now();
  void cache.invalidateQueries({ predicate: ({ queryKey }) => hints.some((hint) => concerns(hint, queryKey)) });
}
