/** What the service takes and answers, by the names that the pages use. */

import type { components } from "./schema.ts";

type Schemas = components["schemas"];

/** The names in their order here. One that the service has and that is missing here is a type error. */
function every<Name extends string>(names: Record<Name, unknown>): readonly Name[] {
  return Object.keys(names) as Name[];
}

export type Fleet = Schemas["FleetOut"];
export type Vehicle = Schemas["VehicleOut"];
export type RigRequest = Schemas["NewRig"];
export type Transform = Schemas["Transform"];
export type Rotation = Transform["rotation"];

export type Me = Schemas["Me"];
export type Member = Schemas["Member"];
export type ChangedMember = Schemas["ChangedMember"];
export type Invitation = Schemas["Invitation"];
export type Role = Member["role"];
/** The least first. */
export const ROLES = every<Role>({ viewer: 0, annotator: 0, reviewer: 0, engineer: 0, admin: 0 });

export type RecordingChange = Schemas["RecordingEdit"];
export type NewRecording = Schemas["NewRecording"];
export type Reading = Schemas["Reading"];
export type Sensor = Schemas["SensorView"];
export type Upload = Schemas["Upload"];
export type UploadedParts = Schemas["Parts"];
export type BlobAddress = Schemas["BlobAddress"];

export type DetectionRequest = Schemas["DetectionRequest"];
export type Pairing = Required<Schemas["Pairing"]>;
export type Vertex = Schemas["VertexView"];
export type JobProgress = Schemas["ProgressView"];

export type MarkingTask = Schemas["TaskView"];
export type MarkingProgress = Schemas["Progress"];
export type MarkingTally = Schemas["Tally"];
export type NewAnswer = Schemas["Answer"] & { mark: MarkPoint | null };
export type MarkPoint = Schemas["Pixel"];
export type OwnAnswer = Schemas["Own"];
export type VerdictName = NewAnswer["verdict"];

export type CorrespondenceSet = Schemas["SetView"];
export type CalibrationRequest = Schemas["CalibrationRequest"];
export type CalibrationTemplate = Schemas["CalibrationTemplate"];
export type ModelName = "pinhole" | "brown_conrady" | "kannala_brandt";
export const MODELS = every<ModelName>({ pinhole: 0, brown_conrady: 0, kannala_brandt: 0 });
export type Publication = Schemas["PublicationView"];

export type FleetRequestBody = Schemas["FleetRequestBody"];
export type VehicleFilter = Schemas["VehicleFilter"];
export type Counts = Schemas["Counts"];
export type CameraOutcome = Schemas["CameraOutcome"];
export type VehicleState = Schemas["RequestVehicleView"]["state"];
export const VEHICLE_STATES = every<VehicleState>({
  queued: 0,
  running: 0,
  done: 0,
  failed: 0,
  cancelled: 0,
  skipped: 0,
});

/** Whether a recording, detection, calibration or request is still being worked on. */
export const isUnderWay = ({ state }: { state: string }): boolean => ["queued", "running", "ingesting"].includes(state);
