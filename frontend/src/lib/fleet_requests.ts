/** Fleet requests as they are typed into the form, and as people read them. */

import type { ApiProblem } from "./api/http.ts";
import { VEHICLE_STATES } from "./api/types.ts";
import type { CameraOutcome, Counts, DryRunView, FleetRequestView, VehicleFilter } from "./api/schema.ts";
import { compact, counted, fixed, moment } from "./format.ts";

export interface FilterDraft {
  name: string;
  rig: string;
  /** As a field of date and time holds it, in the reader's own time zone. */
  since: string;
  newPairs: boolean;
  /** Vehicles picked by hand; none means that all may match. */
  picked: string[];
}

export const newFilter = (): FilterDraft => ({ name: "", rig: "", since: "", newPairs: false, picked: [] });

/** Only what was filled in: what is absent is true of every vehicle. */
export function filterOf(draft: FilterDraft): VehicleFilter {
  const since = draft.since ? new Date(draft.since) : null;
  return {
    ...(draft.picked.length > 0 ? { vehicle_ids: draft.picked } : {}),
    ...(draft.name.trim() ? { name: draft.name.trim() } : {}),
    ...(draft.rig.trim() ? { rig: draft.rig.trim() } : {}),
    ...(since && !Number.isNaN(since.getTime()) ? { not_calibrated_since: since.toISOString() } : {}),
    ...(draft.newPairs ? { new_pairs: true } : {}),
  };
}

export function filterInWords(asked: FleetRequestView["asked"]["vehicles"]): string {
  const picked = asked.named ?? 0;
  const conditions = [
    ...(asked.name ? [`named ${asked.name}`] : []),
    ...(asked.rig ? [`with a rig ${asked.rig}`] : []),
    ...(asked.not_calibrated_since ? [`not calibrated since ${moment(asked.not_calibrated_since)}`] : []),
    ...(asked.new_pairs ? ["with newer pairs than published"] : []),
  ].join(", ");
  if (picked > 0) return `${counted(picked, "vehicle")} picked by hand${conditions ? `, ${conditions}` : ""}`;
  return conditions ? `vehicles ${conditions}` : "all vehicles";
}

/** "270 done, 6 failed, 24 skipped": the states that somebody is in. */
export function countsInWords(counts: Counts): string {
  const parts = VEHICLE_STATES.filter((state) => counts[state] > 0).map(
    (state) => `${compact(counts[state])} ${state}`,
  );
  return parts.join(", ") || "no vehicle was due";
}

/** "published for 2 of 4": of those that are done; empty where nobody asked for it, or it is not known yet. */
export function publishedInWords({ published, counts }: Pick<FleetRequestView, "published" | "counts">): string {
  return typeof published === "number" ? `published for ${compact(published)} of ${compact(counts.done)}` : "";
}

function processorTime(seconds: number): string {
  const minutes = Math.ceil(seconds / 60);
  return minutes < 90 ? counted(minutes, "processor minute") : `${fixed(seconds / 3600, 1)} processor hours`;
}

/** What a dry run says, in a sentence. */
export function dryRunInWords(found: DryRunView): string {
  if (found.matched === 0) return "No vehicle is due: the filter leaves nobody now.";
  const skipped = found.skipped > 0 ? `; ${compact(found.skipped)} would be skipped` : "";
  const work = `${counted(found.runs, "run")} (at most ${processorTime(found.processor_seconds)})`;
  const runs = found.calibrations > 0 ? ` in ${work}` : "";
  const match = found.matched === 1 ? "matches" : "match";
  return `${counted(found.matched, "vehicle")} ${match}: ${compact(found.calibrations)} would be calibrated${runs}${skipped}.`;
}

/** A camera's outcome: model, error, and what became of the publication where one was asked for. */
export function outcomeInWords(camera: string, found: CameraOutcome): string {
  const error =
    found.heldout_mean_px !== null
      ? `${fixed(found.heldout_mean_px)} px held out`
      : `${fixed(found.mean_px)} px on fitted pairs`;
  const fitted = found.model ? `${found.model}, ${error}` : "no model recommended";
  return `${camera}: ${fitted}${found.published ? ", published" : ""}`;
}

export type FormPart = "vehicles" | "calibration" | "request";

/** The part of the form that a refusal is about. */
export function partOf(problem: ApiProblem): FormPart {
  if (["no_vehicle_matches", "unknown_vehicle"].includes(problem.code)) return "vehicles";
  if (problem.status !== 422 || problem.code === "fleet_request_too_large") return "request";
  const field = problem.fields[0]?.field ?? "";
  if (field.startsWith("vehicles")) return "vehicles";
  // The pairs are chosen by the service: what else it refuses is an option.
  return "calibration";
}
