/** How a camera's results moved over time, as lines to draw. */

import type { DriftStep } from "./api/schema.ts";

export interface DriftPoint {
  /** Milliseconds since 1970. */
  at: number;
  value: number;
  /** Of this result alone; null where it states none. */
  std: number | null;
  withdrawn: boolean;
}

export interface DriftLine {
  name: string;
  points: DriftPoint[];
}

const AXES = ["x", "y", "z"] as const;

/** Turns in degrees or shifts in millimetres about and along the camera's axes, from the first result that stands. */
export function driftLines(steps: readonly DriftStep[], of: "turn" | "shift"): DriftLine[] {
  const first = steps.find((step) => !step.withdrawn);
  return AXES.map((name, axis) => ({
    name,
    points: steps.flatMap((step) => {
      const apart = of === "turn" ? step.from_first?.turn_deg : step.from_first?.shift_mm;
      const value = step === first ? 0 : apart?.[axis];
      const std = step.std[of === "turn" ? `rotation_${name}` : `t_${name}`] ?? null;
      if (value === undefined) return [];
      return [
        {
          at: Date.parse(step.at),
          value,
          std: std === null || of === "turn" ? std : 1000 * std,
          withdrawn: Boolean(step.withdrawn),
        },
      ];
    }),
  }));
}

/** When a result stands that differs from the one before it by more than chance does. */
export const jumpsOf = (steps: readonly DriftStep[]): number[] =>
  steps.filter((step) => step.from_previous?.differs && !step.withdrawn).map((step) => Date.parse(step.at));
