/** Whether workers answer: those that take a kind of job. */

import { read } from "./reads.ts";

const POLL_MS = 1000;

/** Read again every second: a worker is silent for 8 s before it is said to answer no more. */
export const workers = () => ({
  ...read("/v1/workers", undefined),
  refetchInterval: () => POLL_MS,
});
