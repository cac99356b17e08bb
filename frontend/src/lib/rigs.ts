/** A rig as it is typed into the form, and the document that the service takes. */

import type { RigRequest } from "./api/types.ts";

export interface CameraDraft {
  name: string;
  topic: string;
  width: number;
  height: number;
  /** Nominal T_camera_lidar: Euler angles zyx in degrees and translation in metres. */
  angles: [number, number, number];
  translation: [number, number, number];
}

export interface RigDraft {
  name: string;
  lidarFrame: string;
  lidarTopic: string;
  cameras: CameraDraft[];
}

/** A camera that looks forward and level, 90, -90, 0 degrees turning x forward into z forward. */
export function newCamera(name: string): CameraDraft {
  return { name, topic: "", width: 1920, height: 1200, angles: [90, -90, 0], translation: [0, 0, 0] };
}

export function rigRequest(draft: RigDraft): RigRequest {
  const lidarFrame = draft.lidarFrame.trim();
  return {
    name: draft.name.trim(),
    lidar: { frame: lidarFrame, topic: draft.lidarTopic.trim() || null },
    T_vehicle_lidar: null,
    cameras: draft.cameras.map((camera) => {
      const name = camera.name.trim();
      const frame = `camera_${name}_optical`;
      return {
        name,
        frame,
        topic: camera.topic.trim() || null,
        image_size: [camera.width, camera.height],
        nominal: {
          to_frame: frame,
          from_frame: lidarFrame,
          rotation: { euler_order: "zyx", angles_deg: [...camera.angles] },
          translation_m: [...camera.translation],
        },
        bounds: {},
      };
    }),
  };
}

/**
 * A rig as people keep it in files, the simulator's rig.json among them: the body of the request, checked by the
 * service. Throws an Error where the file describes no rig.
 */
export function rigFromFile(text: string, name: string): RigRequest {
  const file = record(JSON.parse(text), "the top");
  if (!("lidar" in file) || !Array.isArray(file.cameras)) throw new Error("A rig file has a lidar and cameras.");
  return { name, ...file } as unknown as RigRequest;
}

function record(value: unknown, where: string): Record<string, unknown> {
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as Record<string, unknown>;
  throw new Error(`A rig file is an object at ${where}.`);
}
