/** Changing the service: what is sent to one of its addresses, typed by the service's own description. */

import { client, once } from "./http.ts";
import type { paths } from "./schema.ts";

/** How a request is sent: with other headers. */
export interface Sending {
  headers: Record<string, string>;
}

type Verb = "post" | "put" | "patch" | "delete";
type Sent<P extends keyof paths, V extends Verb> = NonNullable<paths[P][V]>;
/** The addresses that take this verb. */
type Writable<V extends Verb> = { [P in keyof paths]: [Sent<P, V>] extends [never] ? never : P }[keyof paths];
type PathOf<P extends keyof paths, V extends Verb> =
  Sent<P, V> extends { parameters: { path: infer T } } ? T : Record<string, never>;
type BodyOf<P extends keyof paths, V extends Verb> =
  Sent<P, V> extends { requestBody?: { content: { "application/json": infer T } } } ? T : undefined;
type Content<T> = T extends { content: { "application/json": infer Answer } } ? Answer : never;
type AnswerOf<P extends keyof paths, V extends Verb> =
  Sent<P, V> extends { responses: infer R }
    ? Content<R[keyof R & (200 | 201 | 202)]> | (204 extends keyof R ? undefined : never)
    : never;

async function write<V extends Verb, P extends Writable<V>>(
  verb: V,
  address: P,
  path: PathOf<P, V>,
  body?: BodyOf<P, V>,
  more: object = {},
): Promise<AnswerOf<P, V>> {
  // The types above say what this address takes and answers; TypeScript cannot follow them for an address of any kind.
  const send = client[verb.toUpperCase() as "POST"] as (address: P, options: object) => Promise<{ data: unknown }>;
  return (await send(address, { params: { path }, body, ...more })).data as AnswerOf<P, V>;
}

/** Creates something: repeating the request creates nothing twice. */
export const create = <P extends Writable<"post">>(
  address: P,
  path: PathOf<P, "post">,
  body?: BodyOf<P, "post">,
  sending?: Sending,
): Promise<AnswerOf<P, "post">> => write("post", address, path, body, sending ?? once());

/** Has something done; `signal` ends the wait for it. */
export const post = <P extends Writable<"post">>(
  address: P,
  path: PathOf<P, "post">,
  body?: BodyOf<P, "post">,
  more: { signal?: AbortSignal } = {},
): Promise<AnswerOf<P, "post">> => write("post", address, path, body, more);

/** By id, the version that this page made of a thing: what it shows may still be the one before. */
const versions = new Map<unknown, number>();

/** Changes the version that was read, where one is stated, or the one that this page has made of it since. */
export async function change<V extends "put" | "patch", P extends Writable<V>>(
  verb: V,
  address: P,
  path: PathOf<P, V>,
  body: BodyOf<P, V>,
  version?: number,
  sending?: Sending,
): Promise<AnswerOf<P, V>> {
  if (version === undefined) return write(verb, address, path, body);
  const { id } = path as { id: string };
  const newest = Math.max(version, versions.get(id) ?? 0);
  const changed = await write(verb, address, path, body, {
    headers: { "If-Match": `"v${newest}"`, ...sending?.headers },
  });
  if (sending) return changed;
  versions.set(id, (changed as { version: number }).version);
  return changed;
}

export const remove = <P extends Writable<"delete">>(
  address: P,
  path: PathOf<P, "delete">,
  sending?: Sending,
): Promise<AnswerOf<P, "delete">> => write("delete", address, path, undefined, sending);
