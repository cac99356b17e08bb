/** What the service takes and answers, by the names that the pages use. */

import type { components, paths } from "./schema.ts";

type Schemas = components["schemas"];

/** The names in their order here. One that the service has and that is missing here is a type error. */
export function every<Name extends string>(names: Record<Name, unknown>): readonly Name[] {
  return Object.keys(names) as Name[];
}

export type Work = Pick<Schemas["JobView"], "kind" | "progress" | "seconds_left">;

export type HealthOrder = NonNullable<
  NonNullable<paths["/v1/fleets/{id}/health"]["get"]["parameters"]["query"]>["order"]
>;
export type Direction = NonNullable<Schemas["ProposalRequest"]["looks"]>[string];
/** The generated type of an answer loses the lengths of vectors. */
export interface RigProposal {
  rig: Schemas["NewRig"];
  notes: string[];
  questions: Schemas["RigQuestion"][];
}
export type ProposalRequest = Partial<Schemas["ProposalRequest"]>;
export type CheckVerdict = Exclude<Schemas["Check"]["verdict"], "not_checked">;
export type Transform = Schemas["Transform"] | Schemas["SolvedTransform"];
export type Rotation = Transform["rotation"];

export type Role = Schemas["Member"]["role"];
/** The least first. */
export const ROLES = every<Role>({ viewer: 0, annotator: 0, reviewer: 0, engineer: 0, admin: 0 });

/** A topic that could not be told from others: further members of a problem are not described. */
export interface Candidate {
  name: string;
  kind: "lidar" | "camera";
  count?: number | null;
  width?: number;
  height?: number;
}

export type RegionParts = Schemas["RegionParts"];
export type Quantity = Schemas["Inequality"]["quantity"];
export type Operator = Schemas["Inequality"]["op"];
export type PairingMode = NonNullable<Schemas["Pairing"]["mode"]>;
export type Analysis = Schemas["AnalysisPage"]["items"][number];
export type AnalysisRequest = paths["/v1/analyses"]["post"]["requestBody"]["content"]["application/json"];

export type NewAnswer = Schemas["Answer"] & { mark: Schemas["Pixel"] | null };
export type VerdictName = NewAnswer["verdict"];

/** The camera models, in the order in which people read them. */
export const MODELS = ["pinhole", "brown_conrady", "kannala_brandt", "rational_polynomial"] as const;
/** Those that a form begins with. */
export const DEFAULT_MODELS = MODELS.slice(0, 3);
export type ModelName = (typeof MODELS)[number];

export type VehicleState = Schemas["RequestVehicleView"]["state"];
const STATES = { queued: 0, running: 0, done: 0, failed: 0, cancelled: 0, skipped: 0 };
export const VEHICLE_STATES = every<VehicleState>(STATES);

/** Whether a recording, detection, calibration or request is still being worked on. */
export const isUnderWay = ({ state }: { state: string }): boolean => ["queued", "running", "ingesting"].includes(state);
