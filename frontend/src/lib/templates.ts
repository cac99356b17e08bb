/** What a calibration is asked to fit: as a form begins, and as people read it. */

import { MODELS, type CalibrationTemplate, type ModelName } from "./api/types.ts";
import { counted, words } from "./format.ts";

/** The options that the form has. */
export type TemplateDraft = { models: ModelName[] } & Required<
  Pick<
    CalibrationTemplate,
    | ("preset" | "search" | "loss" | "outliers" | "bounds_preset")
    | ("intrinsics_from" | "line_time_us" | "folds" | "farm" | "seed" | "publish")
  >
>;

export const newTemplate = (): TemplateDraft => ({
  models: [...MODELS],
  preset: "default",
  search: null,
  loss: "mean",
  outliers: "keep",
  bounds_preset: null,
  intrinsics_from: "bounds",
  line_time_us: 0,
  folds: 5,
  farm: "auto",
  seed: null,
  publish: "none",
});

/** The models, and every option that is not the usual one. */
export function templateInWords(asked: CalibrationTemplate): string {
  const usual = newTemplate();
  const parts = [(asked.models ?? usual.models).join(", ")];
  if (asked.preset && asked.preset !== usual.preset) parts.push(`preset ${asked.preset}`);
  if (asked.search) parts.push(words(asked.search));
  if (asked.bounds_preset) parts.push(`bounds ${asked.bounds_preset}`);
  if (asked.intrinsics_from === "recording") parts.push("focal lengths near the recording's");
  if (asked.loss && asked.loss !== usual.loss) parts.push(`${asked.loss} loss`);
  if (asked.outliers === "exclude") parts.push("outliers excluded");
  if (asked.line_time_us) parts.push(`rolling shutter of ${asked.line_time_us} µs a row`);
  const folds = asked.folds ?? usual.folds;
  parts.push(folds === 0 ? "nothing held out" : counted(folds, "fold"));
  if (typeof asked.seed === "number") parts.push(`seed ${asked.seed}`);
  if (asked.publish === "recommended") parts.push("publish what is recommended");
  return parts.join("; ");
}
