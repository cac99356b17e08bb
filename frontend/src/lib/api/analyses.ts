/** Analyses: each is asked for, and read until it has ended. */

import { bodyOf, client } from "./http.ts";
import { read, readAll, type Read } from "./reads.ts";
import { create, remove } from "./writes.ts";
import { isUnderWay, type Analysis, type AnalysisRequest } from "./types.ts";

const POLL_MS = 400;

type Kind = Analysis["kind"];
type AnalysisOf<K extends Kind> = Extract<Analysis, { kind: K }>;
/** What analyses are of. */
type Subject = { recording_id: string } | { result_id: string };

export const ask = (body: AnalysisRequest) => create<"/v1/analyses">("/v1/analyses", {}, body);

/** Asks, reads until the analysis has ended, and tells of each reading. */
export async function analyse<K extends Kind>(
  body: AnalysisRequest & { kind: K },
  tell: (analysis: AnalysisOf<K>) => void,
): Promise<AnalysisOf<K>> {
  for (let work = await ask(body); ;) {
    // The service answers the kind that was asked for.
    tell(work as AnalysisOf<K>);
    if (!isUnderWay(work)) return work as AnalysisOf<K>;
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    work = await bodyOf(client.GET("/v1/analyses/{analysis_id}", { params: { path: { analysis_id: work.id } } }));
  }
}

/** Those of a subject that are of one kind, the newest first. */
export const analyses = <K extends Kind>(subject: Subject, kind: K, most = 1000): Read<AnalysisOf<K>[]> =>
  readAll(
    "/v1/analyses",
    undefined,
    { ...subject, kind: [kind] },
    (found) => found.some(isUnderWay),
    most,
  ) as unknown as Read<AnalysisOf<K>[]>;

export const VALIDATIONS_PER_PAGE = 10;

/** The validations of a vehicle, the newest first. */
export const validations = (vehicle_id: string, after: string | undefined) =>
  read(
    "/v1/analyses",
    undefined,
    {
      vehicle_id,
      kind: ["pair_validation", "lane_validation", "edge_validation"],
      after,
      limit: VALIDATIONS_PER_PAGE,
    },
    (page) => page.items.some(isUnderWay),
  );

export const deleteAnalysis = (analysis_id: string) => remove("/v1/analyses/{analysis_id}", { analysis_id });

export const fileUrl = (id: string): string => `/v1/analyses/${id}/file`;
