/** Reading the service: what is read is named by its address, by which the cache keeps it. */

import { asProblem, client, type ApiProblem, type Page } from "./http.ts";
import type { paths } from "./schema.ts";

export const POLL_MS = 2000;

type Answer<P extends keyof paths> = paths[P]["get"] extends {
  responses: { 200: { content: { "application/json": infer T } } };
}
  ? T
  : never;
/** The addresses that answer a GET with JSON. */
type Readable = { [P in keyof paths]: [Answer<P>] extends [never] ? never : P }[keyof paths];
type Listing = { [P in Readable]: Answer<P> extends Page<unknown> ? P : never }[Readable];
type Item<P extends Listing> = Answer<P> extends Page<infer T> ? T : never;
type Asked<P extends Readable> = NonNullable<paths[P]["get"]>["parameters"];
type Path<P extends Readable> = Asked<P> extends { path: infer T } ? { [K in keyof T]: T[K] | undefined } : undefined;
type Query<P extends Readable> =
  Asked<P> extends { query?: infer T } ? { [K in keyof NonNullable<T>]?: NonNullable<T>[K] | undefined } : object;

/** What a component reads: see `reading` of the cache. */
export interface Read<T> {
  queryKey: readonly unknown[];
  queryFn: () => Promise<T>;
  /** False while a part of the address is not known. */
  enabled: boolean;
  refetchInterval: (query: { state: { data: T | undefined; error: ApiProblem | null } }) => number | false;
}

/** Whether work is under way, so that progress is worth asking for every two seconds. */
type IsBusy<T> = (data: T) => boolean;

/** Reads one address. */
export function read<P extends Readable>(
  address: P,
  path: Path<P>,
  query: Query<P> = {} as Query<P>,
  isBusy?: IsBusy<Answer<P>>,
): Read<Answer<P>> {
  return kept(address, path, query, () => got(address, path, query), isBusy);
}

/** Reads all items of a listing, up to `most` and the rest of their page. */
export function readAll<P extends Listing>(
  address: P,
  path: Path<P>,
  query: Query<P> = {} as Query<P>,
  isBusy?: IsBusy<Item<P>[]>,
  most = 1000,
): Read<Item<P>[]> {
  const work = async (): Promise<Item<P>[]> => {
    const items: Item<P>[] = [];
    let after: string | null | undefined;
    do {
      const page = (await got(address, path, { ...query, after })) as Page<Item<P>>;
      items.push(...page.items);
      after = page.next;
    } while (after && items.length < most);
    return items;
  };
  return kept(address, path, query, work, isBusy);
}

/** The segments of the address, and the query where there is one. */
function keyOf(address: string, path: object | undefined, query: object): readonly unknown[] {
  const given = new Map<string, unknown>(Object.entries(path ?? {}));
  const segments = address.split("/").slice(2);
  const named = segments.map((segment) => (segment.startsWith("{") ? given.get(segment.slice(1, -1)) : segment));
  return Object.keys(query).length > 0 ? [...named, query] : named;
}

function kept<T>(
  address: string,
  path: object | undefined,
  query: object,
  work: () => Promise<T>,
  isBusy: IsBusy<T> | undefined,
): Read<T> {
  return {
    queryKey: keyOf(address, path, query),
    queryFn: () =>
      work().catch((error: unknown) => {
        throw asProblem(error);
      }),
    enabled: Object.values(path ?? {}).every((part) => part !== undefined && part !== ""),
    refetchInterval: ({ state: { data } }) => data !== undefined && isBusy?.(data) === true && POLL_MS,
  };
}

async function got<P extends Readable>(address: P, path: Path<P>, query: object): Promise<Answer<P>> {
  // The types above say what this address takes and answers; TypeScript cannot follow them for an address of any kind.
  const get = client.GET as (address: P, options: object) => Promise<{ data: Answer<P> }>;
  return (await get(address, { params: { path, query } })).data;
}
