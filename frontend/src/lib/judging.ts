/** What became of each sweep of a detection, and the corner that a vertex states. */

import type { DetectionView, VertexSummary, VertexView } from "./api/schema.ts";
import { words } from "./format.ts";
import type { Extent } from "./points/cloud.ts";
import type { Lines } from "./points/scene.ts";

/** The colour of a corner in 3D. */
export const CORNER = "#e0007a";

export type Verdict = "found" | "uncertain" | "refused";

/** How each is drawn: by shape and height, not by colour alone. */
export const VERDICTS = {
  found: { shape: "●", tone: "good", colour: "var(--ok)", height: 1 },
  uncertain: { shape: "▲", tone: "caution", colour: "var(--warn)", height: 0.55 },
  refused: { shape: "✕", tone: "bad", colour: "var(--bad)", height: 0.2 },
} as const;

export interface Judged {
  index: number;
  verdict: Verdict;
  /** Why it was refused or is uncertain; empty for a vertex that says nothing of the kind. */
  reason: string;
  /** The reason in a sentence; empty where there is none. */
  sentence: string;
  vertex: VertexSummary | null;
}

/** Every sweep of a detection in order: `count` of them. A vertex is uncertain if it is flagged. */
export function judgedSweeps(detection: DetectionView, vertices: readonly VertexSummary[], count: number): Judged[] {
  const judged = Array.from({ length: count }, (_, index): Judged => ({
    index,
    verdict: "refused",
    reason: "",
    sentence: "",
    vertex: null,
  }));
  for (const [reason, runs] of Object.entries(detection.counts.refused_sweeps ?? {})) {
    for (const [first = 0, last = -1] of runs) {
      for (let index = first; index <= last && index < count; index += 1) {
        const sentence = detection.reasons?.[reason] ?? "";
        judged[index] = { index, verdict: "refused", reason: words(reason), sentence, vertex: null };
      }
    }
  }
  for (const vertex of vertices) {
    const reason = vertex.flags.map((flag) => words(flag.name)).join(", ");
    const verdict = reason ? "uncertain" : "found";
    const sentence = vertex.flags.map((flag) => flag.sentence).join("; ");
    const index = vertex.sweep_index;
    if (index < count) judged[index] = { index, verdict, reason, sentence, vertex };
  }
  return judged;
}

export interface Kind {
  verdict: Verdict;
  reason: string;
  count: number;
}

/** Which verdicts and reasons there are, in that order, the most frequent reason first. */
export function kindsOf(judged: readonly Judged[]): Kind[] {
  const kinds = new Map<string, Kind>();
  for (const { verdict, reason } of judged) {
    const kind = kinds.get(`${verdict} ${reason}`) ?? { verdict, reason, count: 0 };
    kind.count += 1;
    kinds.set(`${verdict} ${reason}`, kind);
  }
  const order: Verdict[] = ["found", "uncertain", "refused"];
  return [...kinds.values()].sort(
    (a, b) =>
      order.indexOf(a.verdict) - order.indexOf(b.verdict) || b.count - a.count || (a.reason < b.reason ? -1 : 1),
  );
}

/** Runs of sweeps with one verdict and reason: first and last place in the list. */
export function runsOf(judged: readonly Judged[]): { first: number; last: number; of: Judged }[] {
  const runs: { first: number; last: number; of: Judged }[] = [];
  judged.forEach((one, place) => {
    const run = runs.at(-1);
    if (run?.of.verdict === one.verdict && run.of.reason === one.reason) run.last = place;
    else runs.push({ first: place, last: place, of: one });
  });
  return runs;
}

/** The next sweep of a kind after a place, from the first one on again; -1 if there is none. */
export function nextOf(judged: readonly Judged[], { verdict, reason }: Omit<Kind, "count">, after: number): number {
  const is = (one: Judged): boolean => one.verdict === verdict && one.reason === reason;
  const next = judged.findIndex((one, place) => place > after && is(one));
  return next >= 0 ? next : judged.findIndex(is);
}

/** The place of the number that is nearest to one in a list; 0 in an empty one. */
export function nearestTo(numbers: readonly number[], wanted: number): number {
  const away = numbers.map((number) => Math.abs(number - wanted));
  return Math.max(0, away.indexOf(Math.min(...away)));
}

type Vector = [number, number, number];

interface Place {
  x: number;
  y: number;
  z: number;
}

/** The axes of a vertex's errors, in metres: the columns of a root of its covariance over x, y, z. */
function rootOf({ x, y, z, covariance }: VertexView): Vector[] | null {
  if (!covariance) return null;
  const level = Math.hypot(x, y);
  const range = Math.hypot(level, z);
  // How x, y, z change with azimuth, elevation and range.
  const axes: Vector[] = [
    [-y, x, 0],
    [(-x * z) / level, (-y * z) / level, level],
    [x / range, y / range, z / range],
  ];
  const at = (i: number, j: number): number => covariance[i]?.[j] ?? 0;
  const a = Math.sqrt(at(0, 0));
  const [b, c] = [at(1, 0) / a, at(2, 0) / a];
  const d = Math.sqrt(Math.max(0, at(1, 1) - b * b));
  const e = d > 0 ? (at(2, 1) - c * b) / d : 0;
  const f = Math.sqrt(Math.max(0, at(2, 2) - c * c - e * e));
  // Columns of Cholesky's lower triangle, each in metres.
  const columns: Vector[] = [
    [a, b, c],
    [0, d, e],
    [0, 0, f],
  ];
  return columns.map(
    (column) =>
      [0, 1, 2].map((axis) => column.reduce((sum, part, i) => sum + part * (axes[i]?.[axis] ?? 0), 0)) as Vector,
  );
}

const STEPS = 48;

/** Three closed curves on the ellipsoid of so many standard deviations around a vertex; null if it states none. */
export function ellipsoid(vertex: VertexView, sigmas: number, colour: string): Lines | null {
  const root = rootOf(vertex);
  if (!root) return null;
  const centre: Vector = [vertex.x, vertex.y, vertex.z];
  const ends: number[] = [];
  for (const [first, second] of [
    [0, 1],
    [1, 2],
    [2, 0],
  ] as const) {
    const on = (step: number): Vector => {
      const angle = (2 * Math.PI * step) / STEPS;
      const [cos, sin] = [sigmas * Math.cos(angle), sigmas * Math.sin(angle)];
      return centre.map(
        (one, axis) => one + cos * (root[first]?.[axis] ?? 0) + sin * (root[second]?.[axis] ?? 0),
      ) as Vector;
    };
    for (let step = 0; step < STEPS; step += 1) ends.push(...on(step), ...on(step + 1));
  }
  return { ends, colour };
}

/** A cross of 10 cm at a vertex. */
export function cross({ x, y, z }: Place, colour: string): Lines {
  const half = 0.05;
  return {
    ends: [x - half, y, z, x + half, y, z, x, y - half, z, x, y + half, z, x, y, z - half, x, y, z + half],
    colour,
  };
}

/** A cross at each of the board's other corners, and the board's edges between those that are known. */
export function board(vertex: VertexView, colour: string): Lines | null {
  const corners = vertex.corners ?? [];
  if (corners.length === 0) return null;
  const known = new Map<string, Place>([["top", vertex], ...corners.map((one): [string, Place] => [one.corner, one])]);
  const around = ["top", "right", "bottom", "left", "top"].map((name) => known.get(name));
  const ends = corners.flatMap((corner) => [...cross(corner, colour).ends]);
  for (const [place, from] of around.slice(0, -1).entries()) {
    const to = around[place + 1];
    if (from && to) ends.push(from.x, from.y, from.z, to.x, to.y, to.z);
  }
  return { ends, colour };
}

/** What is shown about a vertex: a board and its holder, metres to each side. */
const AROUND_M = 1.2;

/** The space about a vertex. */
export function closeTo({ x, y, z }: Place): Extent {
  return { min: [x - AROUND_M, y - AROUND_M, z - AROUND_M], max: [x + AROUND_M, y + AROUND_M, z + AROUND_M / 3] };
}

/** Standard deviations of a vertex across the ray, up and along it, millimetres; null if it states none. */
export function sigmasMm({ x, y, z, covariance }: VertexView): [number, number, number] | null {
  if (!covariance) return null;
  const sigma = (i: number): number => 1000 * Math.sqrt(covariance[i]?.[i] ?? 0);
  const level = Math.hypot(x, y);
  return [sigma(0) * level, sigma(1) * Math.hypot(level, z), sigma(2)];
}
