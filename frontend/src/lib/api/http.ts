/** One way to the service: JSON in, JSON out, and every refusal as an `ApiProblem` that says what to do. */

/** An RFC 9457 problem document as a job, a recording or an answer carries it. */
export interface ProblemDocument {
  title?: string;
  detail?: string;
  code?: string;
  hint?: string | null;
  [extra: string]: unknown;
}

export class ApiProblem extends Error {
  readonly status: number;
  readonly code: string;
  readonly hint: string;
  readonly document: ProblemDocument;

  /** What is wrong with each field of an invalid request. */
  get fields(): { field: string; message: string }[] {
    const errors = this.document["errors"];
    return Array.isArray(errors) ? errors : [];
  }

  constructor(status: number, document: ProblemDocument) {
    super(document.detail ?? document.title ?? `The service answered ${status}.`);
    this.status = status;
    this.code = document.code ?? "unknown";
    this.hint = document.hint ?? "";
    this.document = document;
  }
}

export interface Answer<T> {
  status: number;
  etag: string | null;
  data: T;
}

export interface RequestOptions {
  body?: unknown;
  headers?: Record<string, string>;
  /** A POST that creates carries a key, so that repeating it creates nothing twice. */
  creates?: boolean;
  signal?: AbortSignal;
}

type Method = "GET" | "POST" | "PUT" | "PATCH" | "DELETE";

const signedOutListeners = new Set<() => void>();

/** Calls `listener` whenever the service says that this browser is not signed in (any more). */
export function onSignedOut(listener: () => void): void {
  signedOutListeners.add(listener);
}

/** 128 random bits. `crypto.randomUUID` is absent where the pages are served over plain HTTP to another host. */
export function randomKey(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export async function request<T>(method: Method, path: string, options: RequestOptions = {}): Promise<Answer<T>> {
  const headers: Record<string, string> = { Accept: "application/json", ...options.headers };
  const init: RequestInit = { method, headers, credentials: "same-origin" };
  if (options.signal) init.signal = options.signal;
  if (options.body instanceof Blob || options.body instanceof ArrayBuffer || typeof options.body === "string") {
    init.body = options.body;
    headers["Content-Type"] ??= "application/octet-stream";
  } else if (options.body !== undefined) {
    init.body = JSON.stringify(options.body);
    headers["Content-Type"] = "application/json";
  }
  if (options.creates) headers["Idempotency-Key"] = randomKey();
  const response = await send(`/v1${path}`, init, options.creates || method === "GET" || method === "PUT");
  if (!response.ok && response.status !== 304) throw await problemOf(response);
  const data = response.status === 204 ? undefined : await response.json();
  return { status: response.status, etag: response.headers.get("ETag"), data: data as T };
}

/** Sends once more where the connection broke and a repetition does no harm. */
async function send(url: string, init: RequestInit, repeatable: boolean): Promise<Response> {
  for (let attempt = 0; ; attempt += 1) {
    try {
      return await fetch(url, init);
    } catch (error) {
      if (init.signal?.aborted) throw error;
      if (!repeatable || attempt >= 2) throw unreachable();
      await new Promise((resolve) => setTimeout(resolve, 300 * 2 ** attempt));
    }
  }
}

function unreachable(): ApiProblem {
  return new ApiProblem(0, {
    code: "unreachable",
    detail: "The service does not answer.",
    hint: "Check that it is running and that this computer is online, then try again. Nothing was lost on this page.",
  });
}

async function problemOf(response: Response): Promise<ApiProblem> {
  let document: ProblemDocument = {};
  try {
    document = (await response.json()) as ProblemDocument;
  } catch {
    document = {
      detail: `The service answered ${response.status} without saying why.`,
      hint: "Try again in a moment.",
    };
  }
  const problem = new ApiProblem(response.status, document);
  if (response.status === 401) for (const listener of signedOutListeners) listener();
  return problem;
}

export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await request<T>("GET", path, signal ? { signal } : {})).data;
}

export async function post<T>(path: string, body?: unknown): Promise<T> {
  return (await request<T>("POST", path, { body: body ?? {} })).data;
}

export async function create<T>(path: string, body: unknown): Promise<T> {
  return (await request<T>("POST", path, { body, creates: true })).data;
}

export interface Page<T> {
  items: T[];
  next: string | null;
}

/** `?a=1&b=2` of the parameters that are given. */
export function query(parameters: Record<string, string | number | null | undefined>): string {
  const given = Object.entries(parameters).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const text = new URLSearchParams(given.map(([name, value]) => [name, String(value)])).toString();
  return text ? `?${text}` : "";
}

/** All items of a paged listing, up to `most`. */
export async function all<T>(path: string, most = 1000): Promise<T[]> {
  const items: T[] = [];
  let cursor: string | null = null;
  do {
    const joint: string = path.includes("?") ? "&" : "?";
    const page: Page<T> = await get<Page<T>>(cursor ? `${path}${joint}after=${encodeURIComponent(cursor)}` : path);
    items.push(...page.items);
    cursor = page.next;
  } while (cursor && items.length < most);
  return items;
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
