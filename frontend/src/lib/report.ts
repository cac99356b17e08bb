/** What a worker writes into a report (`workers/reports/contents.py`), and the pairs of a result as columns. */

import type { CameraSummary, OffsetCurve, ResultView, SetWithPairs } from "./api/schema.ts";
import { mountOf, projectionOf } from "./overlay/projection.ts";

type Column = readonly (number | string | null)[];
/** Columns of equal lengths, a row for each pair: metres in the LiDAR's frame, pixels. */
export type PairColumns = Record<"x" | "y" | "z" | "u" | "v", readonly number[]> & Partial<Record<string, Column>>;

/** The service's rows as columns. */
export function columnsOf(rows: SetWithPairs["pairs"]): PairColumns {
  const column = (name: "x" | "y" | "z" | "u" | "v"): number[] => rows.map((row) => row[name]);
  const columns = { x: column("x"), y: column("y"), z: column("z"), u: column("u"), v: column("v") };
  const stamp_ns = rows.flatMap((row) => row.stamp_ns ?? []);
  return stamp_ns.length === rows.length ? { ...columns, stamp_ns } : columns;
}

export interface ReportPicture {
  address: string;
  width: number;
  height: number;
}

export interface OtherData {
  kind: "pairs" | "lanes" | "edges";
  data: string;
  at: string;
  verdict: "agrees" | "disagrees" | "unknown";
  sentence: string;
  curves?: OffsetCurve[] | null;
  chance?: number | null;
}

export interface ReportDocument {
  names: { vehicle: string; rig: string; camera: string };
  made_at: string;
  result: ResultView;
  summary: CameraSummary | null;
  pairs: PairColumns;
  /** See `upperCorner`. */
  upper_corner: number;
  /** Of each person: the pairs' numbers and the marks. */
  people: { name: string; pair: number[]; u: number[]; v: number[] }[];
  elsewhere: OtherData[];
  request: unknown;
  /** Frames by number of the pair. */
  pictures: Record<number, ReportPicture>;
}

export interface Residuals {
  projected: { u: Float64Array; v: Float64Array };
  /** Mark minus projection, pixels; NaN without a projection. */
  off: { u: Float64Array; v: Float64Array };
  /** Its length; the image's diagonal without a projection, as the solver counts. */
  error_px: Float64Array;
  range_m: Float64Array;
  /** Between the point and the camera's axis. */
  angle_deg: Float64Array;
}

/** Each pair under a result's mount and lens. */
export function residualsOf({ transform, intrinsics }: ResultView, pairs: PairColumns): Residuals {
  const { rotation, translation } = mountOf(transform);
  const project = projectionOf(intrinsics);
  const [width = 0, height = 0] = intrinsics.image_size;
  const column = (): Float64Array => new Float64Array(pairs.x.length).fill(NaN);
  const [projected, off] = [0, 1].map(() => ({ u: column(), v: column() })) as [Residuals["off"], Residuals["off"]];
  const [error_px, range_m, angle_deg] = [column().fill(Math.hypot(width, height)), column(), column()];
  const pixel = { u: NaN, v: NaN };
  pairs.x.forEach((x, i) => {
    const [y = NaN, z = NaN, u = NaN, v = NaN] = [pairs.y[i], pairs.z[i], pairs.u[i], pairs.v[i]];
    const [a, b, c] = rotation.map((row, k) => row[0] * x + row[1] * y + row[2] * z + (translation[k] ?? 0)) as [
      number,
      number,
      number,
    ];
    range_m[i] = Math.hypot(x, y, z);
    angle_deg[i] = (Math.atan2(Math.hypot(a, b), c) * 180) / Math.PI;
    if (!project(a, b, c, pixel)) return;
    [projected.u[i], projected.v[i]] = [pixel.u, pixel.v];
    [off.u[i], off.v[i]] = [u - pixel.u, v - pixel.v];
    error_px[i] = Math.hypot(u - pixel.u, v - pixel.v);
  });
  return { projected, off, error_px, range_m, angle_deg };
}

/** Rings about the axis with equally many of the pairs of these numbers: degrees, and the RMS of their errors. */
export function ringsOf({ angle_deg, error_px }: Residuals, numbers: readonly number[], count = 4): number[][] {
  const sorted = numbers.toSorted((a, b) => (angle_deg[a] ?? 0) - (angle_deg[b] ?? 0));
  return Array.from({ length: count }, (_, k) => {
    const ring = sorted.slice((k * sorted.length) / count, ((k + 1) * sorted.length) / count);
    const rms = Math.sqrt(ring.reduce((sum, i) => sum + (error_px[i] ?? 0) ** 2, 0) / ring.length);
    return [angle_deg[ring[0] ?? -1] ?? NaN, angle_deg[ring.at(-1) ?? -1] ?? NaN, rms];
  }).filter(([, , rms]) => Number.isFinite(rms));
}

/** Bands of range, metres; the last has no end. */
export const BANDS_M = [0, 6, 12, 20, 30, Infinity];
const COLUMNS = 6;

/** The number of pairs by band of range and by sixth of the image of this width, from left to right. */
export function coverageOf({ u }: PairColumns, { range_m }: Residuals, width: number): number[][] {
  const counts = BANDS_M.slice(1).map(() => new Array<number>(COLUMNS).fill(0));
  range_m.forEach((range, i) => {
    const row = counts[BANDS_M.findLastIndex((from) => from <= range)] ?? [];
    const column = Math.min(COLUMNS - 1, Math.max(0, Math.floor((COLUMNS * ((u[i] ?? 0) + 0.5)) / width)));
    row[column] = (row[column] ?? 0) + 1;
  });
  return counts;
}
