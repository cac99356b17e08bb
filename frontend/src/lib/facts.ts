/** What a reader found, as people read it: a label and one or more lines for each fact that says something. */
import { compact, seconds, sentence, words } from "./format.ts";

export interface Fact {
  name: string;
  lines: string[];
}

const LABELS: Record<string, string> = {
  first_ns: "first message",
  last_ns: "last message",
  seconds: "length",
  together_s: "all sensors together",
  overlap_s: "together with the LiDAR",
  overlap_share: "share of the LiDAR's time",
  rate_hz: "rate",
  offset_ns: "its clock minus the LiDAR's, by the times of recording",
  spread_ns: "spread of these times",
  gap_count: "gaps",
  missing: "messages missing in them",
  jumps: "jumps of the clock",
  backwards: "stamps that go back",
  duplicates: "stamps that are repeated",
  time_source: "times of the points",
  stamp_convention: "a stamp is the sweep's",
  ring_count: "rings",
  points: "points of a usual sweep",
  partial: "incomplete sweeps",
  transcoded: "images encoded anew",
  sizes: "size",
  camera_info: "stated intrinsics",
  static_transforms: "fixed frames",
};
/** Said by another fact, shown by themselves, or a list of single events that the warnings sum up. */
const UNSAID = new Set(["gaps", "width", "height", "empty", "omissions"]);

// A stamp from before 1980 counts from the start of something else.
const SINCE_UNIX_NS = 315_532_800e9;

/** A moment in UTC, to the millisecond, from nanoseconds of the Unix clock. */
export function utc(ns: number): string {
  const date = new Date(ns / 1e6);
  return Number.isNaN(date.getTime()) ? "–" : date.toISOString().replace("T", " ").replace("Z", " UTC");
}

/** A stamp as its clock tells it: a moment in UTC, or seconds where the clock began with the recording. */
export function instant(ns: number): string {
  return ns < SINCE_UNIX_NS ? `${(ns / 1e9).toFixed(3)} s` : utc(ns);
}

/** Facts that say something: nothing that is absent or zero. */
export function factsOf(found: Record<string, unknown> | null | undefined): Fact[] {
  return Object.entries(found ?? {})
    .filter(([name, value]) => !UNSAID.has(name) && !isEmpty(value))
    .map(([name, value]) => ({ name: LABELS[name] ?? words(name), lines: linesOf(name, value) }));
}

function isEmpty(value: unknown): boolean {
  return (
    value === null || value === undefined || value === "" || value === 0 || (Array.isArray(value) && value.length === 0)
  );
}

function linesOf(name: string, value: unknown): string[] {
  if (typeof value === "boolean") return [value ? "yes" : "no"];
  if (Array.isArray(value)) return value.flatMap((each) => linesOf(name, each));
  if (typeof value === "number") return [measured(name, value)];
  if (name === "camera_info") return intrinsics(value as Record<string, unknown>);
  const parts = typeof value === "object" && value !== null ? (value as Record<string, unknown>) : {};
  if (name === "static_transforms") return [`${sentence(parts.child)} in ${sentence(parts.parent)}`];
  if (name === "sizes")
    return [`${sentence(parts.width)} × ${sentence(parts.height)} (${compact(parts.count)} frames)`];
  if (typeof parts.after_ns === "number" && typeof parts.duration_ns === "number") {
    return [`${(parts.duration_ns / 1e9).toFixed(3)} s after ${utc(parts.after_ns)}`];
  }
  return [name === "notes" || name === "format" ? sentence(value) : words(sentence(value))];
}

function measured(name: string, value: number): string {
  if (name === "first_ns" || name === "last_ns") return utc(value);
  if (name.endsWith("_ns")) return `${(value / 1e6).toFixed(1)} ms`;
  if (name.endsWith("_share")) return `${(100 * value).toFixed(1)} %`;
  if (name.endsWith("_hz")) return `${value.toFixed(2)} Hz`;
  return name === "seconds" || name.endsWith("_s") ? seconds(value) : compact(value);
}

/** Model, focal lengths and centre; the matrix is row-major. */
function intrinsics(info: Record<string, unknown>): string[] {
  const K = Array.isArray(info.K) ? (info.K as number[]) : [];
  const D = Array.isArray(info.D) ? (info.D as number[]) : [];
  const matrix = `f ${compact(K[0])}, ${compact(K[4])}; centre ${compact(K[2])}, ${compact(K[5])} pixels`;
  const lens = D.length > 0 ? [`distortion ${D.map(compact).join(", ")}`] : [];
  return [`${sentence(info.model)}, ${sentence(info.width)} × ${sentence(info.height)}`, matrix, ...lens];
}

interface Clocked {
  kind: string;
  facts: { offset_ns?: number | null };
}

/** Clocks nearer to each other than the largest gap of a pair need no detection of their own. */
const ALIKE_NS = 50e6;

const offsetsOf = (sensors: Clocked[]): number[] =>
  sensors.filter(({ kind }) => kind === "camera").map(({ facts }) => facts.offset_ns ?? 0);

/** Whether the cameras' clocks are apart from each other, as the times of recording tell it. */
export function clocksDiffer(sensors: Clocked[]): boolean {
  const offsets = offsetsOf(sensors);
  return Math.max(...offsets) - Math.min(...offsets) > ALIKE_NS;
}

/**
 * The cameras' clock minus the LiDAR's, ns, as the times of recording tell it; 0 where they tell nothing, and where the
 * cameras' clocks differ: a detection pairs all cameras with one offset.
 */
export const clockOffsetNs = (sensors: Clocked[]): number =>
  clocksDiffer(sensors) ? 0 : (offsetsOf(sensors).find((offset) => offset !== 0) ?? 0);
