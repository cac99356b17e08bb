/** What the service takes and answers, by the names that the pages use. */

import type { components, paths } from "./schema.ts";

type Schemas = components["schemas"];

/** The names in their order here. One that the service has and that is missing here is a type error. */
export function every<Name extends string>(names: Record<Name, unknown>): readonly Name[] {
  return Object.keys(names) as Name[];
}

export type ProblemDocument = Schemas["ProblemView"];
export type WorkState = Schemas["WorkState"];
export type Work = Pick<Schemas["JobView"], "kind" | "progress" | "seconds_left">;
export type WorkerStanding = Schemas["WorkerStanding"];

export type Fleet = Schemas["FleetOut"];
export type FleetHealth = Schemas["FleetHealth"];
export type CameraState = Schemas["CameraState"];
export type HealthOrder = NonNullable<
  NonNullable<paths["/v1/fleets/{id}/health"]["get"]["parameters"]["query"]>["order"]
>;
export type Vehicle = Schemas["VehicleOut"];
export type Rig = Schemas["RigOut"];
export type RigRequest = Schemas["NewRig"];
export type Direction = NonNullable<Schemas["ProposalRequest"]["looks"]>[string];
/** The generated type of an answer loses the lengths of vectors. */
export interface RigProposal {
  rig: RigRequest;
  notes: string[];
  questions: Schemas["RigQuestion"][];
}
export type ProposalRequest = Partial<Schemas["ProposalRequest"]>;
export type PublicationPolicy = Schemas["PublicationPolicy"];
export type Check = Schemas["Check"];
export type CheckVerdict = Check["verdict"];
export type SensorSerials = Schemas["SensorSerials"];
export type Transform = Schemas["Transform"] | Schemas["SolvedTransform"];
export type Rotation = Transform["rotation"];

export type Me = Schemas["Me"];
export type Member = Schemas["Member"];
export type ChangedMember = Schemas["ChangedMember"];
export type Invitation = Schemas["Invitation"];
export type Role = Member["role"];
/** The least first. */
export const ROLES = every<Role>({ viewer: 0, annotator: 0, reviewer: 0, engineer: 0, admin: 0 });

export type RecordingSummary = Schemas["RecordingSummary"];
export type Recording = Schemas["RecordingView"];
export type RecordingChange = Schemas["RecordingEdit"];
export type NewRecording = Schemas["NewRecording"];
export type Sensor = Schemas["SensorView"];
export type UploadedParts = Schemas["Parts"];
export type SweepPlace = Schemas["SweepView"];
export type FramePlace = Schemas["FrameView"];
export type BlobAddress = Schemas["BlobAddress"];

export type RoadScore = Schemas["RoadScore"];
export type OffsetCurve = Schemas["OffsetCurve"];

/** A topic that could not be told from others: further members of a problem are not described. */
export interface Candidate {
  name: string;
  kind: "lidar" | "camera";
  count?: number | null;
  width?: number;
  height?: number;
}

export type RegionNode = Schemas["RegionNode"] | Schemas["Level"];
export type Quantity = Schemas["Inequality"]["quantity"];
export type Operator = Schemas["Inequality"]["op"];
export type DetectionRequest = Schemas["DetectionRequest"];
export type Detection = Schemas["DetectionView"];
export type PairingMode = NonNullable<Schemas["Pairing"]["mode"]>;
export type Vertex = Schemas["VertexSummary"];
export type VertexDetails = Schemas["VertexView"];
export type AnalysisPage = Schemas["AnalysisPage"];
export type Analysis = AnalysisPage["items"][number];
export type AnalysisRequest = paths["/v1/analyses"]["post"]["requestBody"]["content"]["application/json"];
export type RegionPreview = Schemas["PreviewView"];
export type RegionCounts = Schemas["RegionPreview"];
export type RegionSuggestion = Schemas["SuggestionView"];
export type ClockOffset = Schemas["OffsetView"];

export type MarkingTask = Schemas["TaskView"];
export type MarkingProgress = Schemas["Progress"];
export type MarkingTally = Schemas["Tally"];
export type OwnPairs = Schemas["OwnPairs"];
export type MarkPoint = Schemas["Pixel"];
export type TakenAnswer = Schemas["AnswerView"];
export type NewAnswer = Schemas["Answer"] & { mark: MarkPoint | null };
export type OwnAnswer = Schemas["Own"];
export type VerdictName = NewAnswer["verdict"];

export type CropView = Schemas["CropView"];
export type CropSheet = Schemas["CropSheet"];
export type CropProgress = Schemas["CropProgress"];
export type CropAnswer = Schemas["CropAnswer"];
export type CropVerdict = Schemas["CropVerdict"];

export type CorrespondenceSet = Schemas["SetView"];
export type SetWithPairs = Schemas["SetWithPairs"];
export type CalibrationRequest = Schemas["CalibrationRequest"];
export type CalibrationTemplate = Schemas["CalibrationTemplate"];
export type Calibration = Schemas["CalibrationView"];
export type CalibrationSummary = Schemas["Summary"];
export type CameraSummary = Schemas["CameraSummary"];
export type ModelSummary = Schemas["ModelSummary"];
export type Errors = Schemas["Errors"];
export type CameraPair = Schemas["CameraPair"];
export type RigConsistency = Schemas["RigSummary"];
export type Result = Schemas["ResultView"];
export type Outlier = Schemas["Outlier"];
export type Publication = Schemas["PublicationView"];
export type StatedFiles = Schemas["CalibrationFiles"];
export type ReadFiles = Schemas["ReadFiles"];
export type StatedComparison = Schemas["StatedComparison"];
export type ResultComparison = Schemas["ResultComparison"];
export type FieldDifference = Schemas["FieldDifference"];
export type Drift = Schemas["Drift"];
export type DriftStep = Schemas["DriftStep"];
export type CurrentCalibration = Schemas["CurrentCalibration"];
/** The camera models, in the order in which people read them. */
export const MODELS = ["pinhole", "brown_conrady", "kannala_brandt"] as const;
export type ModelName = (typeof MODELS)[number];

export type FleetRequest = Schemas["FleetRequestView"];
export type FleetRequestBody = Schemas["FleetRequestBody"];
export type VehicleFilter = Schemas["VehicleFilter"];
export type Counts = Schemas["Counts"];
export type CameraOutcome = Schemas["CameraOutcome"];
export type RequestVehicle = Schemas["RequestVehicleView"];
export type VehicleState = RequestVehicle["state"];
export const VEHICLE_STATES = every<VehicleState>({
  queued: 0,
  running: 0,
  done: 0,
  failed: 0,
  cancelled: 0,
  skipped: 0,
});
export type DryRun = Schemas["DryRunView"];

/** Whether a recording, detection, calibration or request is still being worked on. */
export const isUnderWay = ({ state }: { state: string }): boolean => ["queued", "running", "ingesting"].includes(state);
