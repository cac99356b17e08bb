/** What a calibration is asked to fit: as a form begins, and as people read it. */

import { DEFAULT_MODELS, type ModelName } from "./api/types.ts";
import type { CalibrationTemplate } from "./api/schema.ts";
import { counted, words } from "./format.ts";

/** What a fit makes of a lens that the recording states. */
export const LENS_USES: Record<NonNullable<CalibrationTemplate["intrinsics_as"]>, string> = {
  auto: "may change a little, or not at all if pairs are few",
  prior: "may change a little",
  locked: "does not change",
  bounds: "only bounds the search",
  free: "is not used",
};

/** Where a skew is looked for if it is fitted. */
export const SKEW_BOUNDS: [number, number] = [-0.1, 0.1];

/** `c_x=960, skew=0` as values by name; null if it does not read so. */
export function locksOf(text: string): Record<string, number> | null {
  const parts = text.split(",").filter((part) => part.trim());
  const locks = parts.map((part) => /^\s*(\w+)\s*=\s*(\S+)\s*$/.exec(part)).map((found) => found?.slice(1) ?? []);
  const locked = locks.map(([name = "", value = "x"]): [string, number] => [name, Number(value)]);
  return locked.every(([name, value]) => name && Number.isFinite(value)) ? Object.fromEntries(locked) : null;
}

/** The options that the form has. */
export type TemplateDraft = { models: ModelName[] } & Required<
  Pick<
    CalibrationTemplate,
    | ("preset" | "search" | "loss" | "outliers" | "bounds_preset")
    | ("intrinsics_as" | "locked" | "bounds" | "line_time_us" | "folds" | "farm" | "seed" | "publish")
  >
>;

export const newTemplate = (): TemplateDraft => ({
  models: [...DEFAULT_MODELS],
  preset: "default",
  search: null,
  loss: null,
  outliers: null,
  bounds_preset: null,
  intrinsics_as: "auto",
  locked: {},
  bounds: {},
  line_time_us: 0,
  folds: 5,
  farm: "auto",
  seed: null,
  publish: "none",
});

/** A request of what the form says. It names no models where they are the usual: a stated lens may add its own. */
export function requestOf({ models, ...options }: TemplateDraft): CalibrationTemplate {
  return models.join() === DEFAULT_MODELS.join() ? options : { models, ...options };
}

/** The models, and every option that is not the usual one. */
export function templateInWords(asked: CalibrationTemplate): string {
  const usual = newTemplate();
  const parts = [(asked.models ?? usual.models).join(", ")];
  if (asked.preset && asked.preset !== usual.preset) parts.push(`preset ${asked.preset}`);
  if (asked.search) parts.push(words(asked.search));
  if (asked.bounds_preset) parts.push(`bounds ${asked.bounds_preset}`);
  const use = asked.intrinsics_as ?? "auto";
  if (use !== usual.intrinsics_as) parts.push(`a stated lens ${LENS_USES[use]}`);
  for (const [name, value] of Object.entries(asked.locked ?? {})) parts.push(`${name} locked at ${value}`);
  if (asked.bounds?.skew) parts.push("skew fitted");
  if (asked.loss) parts.push(`${asked.loss} loss`);
  if (asked.outliers) parts.push(asked.outliers === "keep" ? "outliers kept" : "outliers excluded");
  if (asked.line_time_us) parts.push(`rolling shutter of ${asked.line_time_us} µs a row`);
  const folds = asked.folds ?? usual.folds;
  parts.push(folds === 0 ? "nothing held out" : counted(folds, "fold"));
  if (typeof asked.seed === "number") parts.push(`seed ${asked.seed}`);
  if (asked.publish === "recommended") parts.push("publish what is recommended");
  return parts.join("; ");
}
