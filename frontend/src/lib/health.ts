/** The table of a fleet's health: what it is sorted and filtered by. */

import type { HealthOrder } from "./api/types.ts";
import type { CameraState, CameraWork } from "./api/schema.ts";
import type { CameraFilter } from "./router.svelte.ts";
import { CAMERA_STATES, CAMERA_WORK } from "./states.ts";

/** What can be sorted by; the first click shows the largest error, the oldest and the gravest first. */
export const COLUMNS: { name: string; order: HealthOrder; turned: HealthOrder; number?: true }[] = [
  { name: "Vehicle", order: "vehicle", turned: "-vehicle" },
  { name: "The car gets", order: "state", turned: "-state" },
  { name: "Error at 20 m", order: "-error_20m_mm", turned: "error_20m_mm", number: true },
  { name: "Since", order: "published_at", turned: "-published_at" },
  { name: "Last recording", order: "recorded_at", turned: "-recorded_at" },
  { name: "Waits for", order: "work", turned: "-work" },
];

/** The filter as the service takes it; what an address misspells is the usual. */
export function healthQuery({ name, state, work, order }: CameraFilter): {
  name?: string;
  state?: CameraState[];
  work?: CameraWork[];
  order?: HealthOrder;
} {
  const orders = COLUMNS.flatMap((column) => [column.order, column.turned]);
  const sorted = orders.find((one) => one === order);
  return {
    ...(name && { name }),
    ...(state in CAMERA_STATES && { state: [state as CameraState] }),
    ...(work in CAMERA_WORK && { work: [work as CameraWork] }),
    ...(sorted && { order: sorted }),
  };
}

/** "3 days", of what happened then. */
export function age(iso: string | null | undefined, now = Date.now()): string {
  if (!iso) return "–";
  const hours = (now - Date.parse(iso)) / 3_600_000;
  const [count, unit] = hours < 1 ? [hours * 60, "min"] : hours < 48 ? [hours, "h"] : [hours / 24, "days"];
  return `${Math.max(Math.floor(count), 0)} ${unit}`;
}
