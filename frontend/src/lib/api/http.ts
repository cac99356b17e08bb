/** One way to the service: typed by its own description, and every refusal an `ApiProblem` that says what to do. */

import createClient from "openapi-fetch";
import type { paths } from "./schema.ts";
import type { ProblemView } from "./schema.ts";

export class ApiProblem extends Error {
  readonly status: number;
  readonly code: string;
  readonly hint: string;
  readonly document: ProblemView;

  /** What is wrong with each field of an invalid request. */
  get fields(): { field: string; message: string }[] {
    const errors = this.document.errors;
    return Array.isArray(errors) ? (errors as { field: string; message: string }[]) : [];
  }

  constructor(status: number, document: ProblemView) {
    super(document.detail ?? `The service answered ${status}.`);
    this.status = status;
    this.code = document.code ?? "unknown";
    this.hint = document.hint ?? "";
    this.document = document;
  }
}

const signedOutListeners = new Set<() => void>();

/** Calls `listener` whenever the service says that this browser is not signed in (any more). */
export function onSignedOut(listener: () => void): void {
  signedOutListeners.add(listener);
}

/** 128 random bits. `crypto.randomUUID` is absent where the pages are served over plain HTTP to another host. */
export function randomKey(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** The header of a POST that creates: repeating the request creates nothing twice. */
export const once = (): { headers: Record<string, string> } => ({ headers: { "Idempotency-Key": randomKey() } });

const PAUSE_MS = 300;
const REPETITIONS = 2;

/**
 * Fetches, and fetches again where the connection broke and a repetition does no harm. Throws an `ApiProblem` for
 * every refusal.
 */
export async function send(request: Request): Promise<Response> {
  const isRepeatable = ["GET", "PUT"].includes(request.method) || request.headers.has("Idempotency-Key");
  for (let attempt = 0; ; attempt += 1) {
    try {
      const response = await fetch(request.clone());
      if (!response.ok) throw await problemOf(response);
      return response;
    } catch (error) {
      if (error instanceof ApiProblem || request.signal.aborted) throw error;
      if (!isRepeatable || attempt >= REPETITIONS) throw unreachable();
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS * 2 ** attempt));
    }
  }
}

export const client = createClient<paths>({ fetch: send });

/** The body of an answer; undefined of one without. */
export async function bodyOf<T>(answer: Promise<{ data?: T }>): Promise<T> {
  return (await answer).data as T;
}

function unreachable(): ApiProblem {
  return new ApiProblem(0, {
    code: "unreachable",
    detail: "The service does not answer.",
    hint: "Check that it is running and that this computer is online, then try again. Nothing was lost on this page.",
  });
}

async function problemOf(response: Response): Promise<ApiProblem> {
  const unexplained = `The service answered ${response.status} without saying why.`;
  const document = await (response.json() as Promise<ProblemView>).catch(() => ({
    detail: unexplained,
    hint: "Try again in a moment.",
  }));
  if (response.status === 401) for (const listener of signedOutListeners) listener();
  return new ApiProblem(response.status, document);
}

export interface Page<T> {
  items: T[];
  next?: string | null;
}

/** Whatever was thrown, as a problem that can be shown. */
export function asProblem(error: unknown): ApiProblem {
  if (error instanceof ApiProblem) return error;
  if (error instanceof DOMException && error.name === "AbortError") {
    return new ApiProblem(0, { code: "stopped", detail: "Stopped." });
  }
  return new ApiProblem(0, {
    code: "page_failed",
    detail: error instanceof Error ? error.message : String(error),
    hint: "Reload the page; if it happens again, report it with what you did.",
  });
}
