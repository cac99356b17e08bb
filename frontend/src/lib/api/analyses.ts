/** Analyses of a recording: each is asked for, and read until it has ended. */

import { bodyOf, client, once } from "./http.ts";
import { readAll, type Read } from "./reads.ts";
import { isUnderWay, type Analysis, type AnalysisRequest } from "./types.ts";

const POLL_MS = 400;

type Kind = Analysis["kind"];
type AnalysisOf<K extends Kind> = Extract<Analysis, { kind: K }>;

export const ask = (recording_id: string, body: AnalysisRequest): Promise<Analysis> =>
  bodyOf(
    client.POST("/v1/recordings/{recording_id}/analyses", { params: { path: { recording_id } }, body, ...once() }),
  );

/** Asks, reads until the analysis has ended, and tells of each reading. */
export async function analyse<K extends Kind>(
  recording_id: string,
  body: AnalysisRequest & { kind: K },
  tell: (analysis: AnalysisOf<K>) => void,
): Promise<AnalysisOf<K>> {
  // The service answers the kind that was asked for.
  const asked = (await ask(recording_id, body)) as AnalysisOf<K>;
  const again = async (analysis_id: string): Promise<AnalysisOf<K>> =>
    (await bodyOf(client.GET("/v1/analyses/{analysis_id}", { params: { path: { analysis_id } } }))) as AnalysisOf<K>;
  return untilEnded<AnalysisOf<K>>(asked, again, tell);
}

/** Reads work until it has ended, and tells of each reading. */
export async function untilEnded<S extends { id: string; state: string }>(
  asked: S,
  read: (id: string) => Promise<S>,
  tell: (work: S) => void,
): Promise<S> {
  for (let work = asked; ; work = await read(work.id)) {
    tell(work);
    if (!isUnderWay(work)) return work;
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
}

/** Those of a recording that are of one kind, the newest first. */
export const analyses = <K extends Kind>(
  recording_id: string | undefined,
  kind: K,
  most = 1000,
): Read<AnalysisOf<K>[]> =>
  readAll(
    "/v1/recordings/{recording_id}/analyses",
    { recording_id },
    { kind },
    (found) => found.some(isUnderWay),
    most,
  ) as unknown as Read<AnalysisOf<K>[]>;

export const deleteAnalysis = (analysis_id: string): Promise<unknown> =>
  client.DELETE("/v1/analyses/{analysis_id}", { params: { path: { analysis_id } } });

export const fileUrl = (id: string): string => `/v1/analyses/${id}/file`;
