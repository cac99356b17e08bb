/** Rigs as files hold them, and whether two describe the same mounts. */

import type { NewRig, RigOut } from "./api/schema.ts";

/**
 * A rig as people keep it in files, the simulator's rig.json among them: the body of the request, checked by the
 * service. Throws an Error where the file describes no rig.
 */
export function rigFromFile(text: string, name: string): NewRig {
  const file = record(JSON.parse(text), "the top");
  if (!("lidar" in file) || !Array.isArray(file.cameras)) throw new Error("A rig file has a lidar and cameras.");
  return { name, ...file } as unknown as NewRig;
}

/** Whether a rig would read and begin as another does: the same topics, frames, sizes, mounts and joints. */
export function sameRig(one: NewRig, other: RigOut): boolean {
  return canonical(one) === canonical(other);
}

function canonical({ lidar, cameras, T_vehicle_lidar }: NewRig | RigOut): string {
  const mounts = cameras.map(({ name, frame, topic, image_size, nominal, joint }) => {
    return { name, frame, topic, image_size, nominal, joint };
  });
  return sorted({ frame: lidar.frame, topic: lidar.topic, mounts, T_vehicle_lidar });
}

/** JSON whose members stand in one order, without those that are null; numbers to 9 digits, far below a micrometre. */
function sorted(value: unknown): string {
  return JSON.stringify(value, (_, item: unknown) => {
    if (typeof item === "number") return Number(item.toFixed(9));
    if (typeof item !== "object" || item === null || Array.isArray(item)) return item;
    const members = Object.entries(item).filter(([, member]) => member !== null);
    return Object.fromEntries(members.sort(([a], [b]) => (a < b ? -1 : 1)));
  });
}

function record(value: unknown, where: string): Record<string, unknown> {
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as Record<string, unknown>;
  throw new Error(`A rig file is an object at ${where}.`);
}
