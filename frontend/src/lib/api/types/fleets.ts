/** Fleets, vehicles, rigs and the transforms between their frames. */

export interface Fleet {
  id: string;
  name: string;
  /** What its recordings take of what they may. */
  taken_bytes: number;
  quota_bytes: number;
}

export interface Vehicle {
  id: string;
  fleet_id: string;
  name: string;
}

export type Rotation =
  { euler_order: "zyx" | "xyz_eq2"; angles_deg: number[] } | { matrix: number[][] } | { quaternion_xyzw: number[] };

export interface Transform {
  to_frame: string;
  from_frame: string;
  rotation: Rotation;
  translation_m: number[];
}

export interface RigCamera {
  name: string;
  frame: string;
  topic: string | null;
  image_size: [number, number];
  nominal: Transform;
  bounds: Record<string, [number, number]>;
}

/** T_cameraA_cameraB as known otherwise. */
export interface CameraTransform {
  transform: Transform;
  std_deg: number;
  std_mm: number;
}

export interface RigRequest {
  name: string;
  lidar: { frame: string; topic: string | null };
  T_vehicle_lidar: Transform | null;
  cameras: RigCamera[];
  camera_transforms?: CameraTransform[];
}

export interface Rig extends RigRequest {
  id: string;
  fleet_id: string;
  vehicle_id: string;
}
