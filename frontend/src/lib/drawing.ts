/** A region as lines and handles in a plane: moving a handle gives another region. Metres. */

import type { Extent } from "./points/cloud.ts";
import {
  cornersOf,
  MAX_CORNERS,
  withParts,
  type Box,
  type Inequality,
  type Member,
  type Part,
  type Point,
  type Polygon,
  type Region,
} from "./region.ts";

export type Plane = "top" | "front" | "side";
type Axis = 0 | 1 | 2;
/** Two of x, y and z: those that the plane shows. */
export type Spot = [number, number];

export const AXES: Record<Plane, [Axis, Axis]> = { top: [0, 1], front: [1, 2], side: [0, 2] };
const LETTERS = ["x", "y", "z"] as const;

export interface Outline {
  spots: Spot[];
  closed: boolean;
  /** What lies inside is cut out. */
  cut: boolean;
}

export interface Handle {
  /** The same while the handle is moved. */
  key: string;
  label: string;
  kind: "corner" | "edge" | "middle" | "turn" | "new";
  at: Spot;
  move: (to: Spot) => Region;
  remove?: () => Region;
}

export interface Drawing {
  outlines: Outline[];
  handles: Handle[];
}

/** Replaces a part, and returns the whole region. */
type Put = (part: Part) => Region;

const SMALLEST_M = 0.1;

/** All that the plane shows of a region. `reach`: where the lines of inequalities end. */
export function drawingOf(region: Region, plane: Plane, reach: Extent): Drawing {
  const parts = [...drawnParts(region, "all", plane, reach), ...drawnParts(region, "none", plane, reach)];
  // Later ones lie over earlier ones, so a corner is taken before the middle under it.
  const handles = parts.flatMap((part) => part.handles).sort((a, b) => RANKS[a.kind] - RANKS[b.kind]);
  return { outlines: parts.flatMap((part) => part.outlines), handles };
}

const RANKS: Record<Handle["kind"], number> = { middle: 0, new: 1, turn: 2, edge: 3, corner: 4 };

function drawnParts(region: Region, member: Member, plane: Plane, reach: Extent): Drawing[] {
  const parts = region[member] ?? [];
  return parts.map((part, i) => {
    const put: Put = (moved) => withParts(region, member, parts.with(i, moved));
    const [key, cut] = [`${member}.${i}`, member === "none"];
    if ("box" in part) return plane === "top" ? boxAbove(part, put, cut, key) : boxBeside(part, put, cut, key, plane);
    if (!("polygon" in part)) return limit(part, put, key, plane, reach);
    return plane === "top" ? polygonAbove(part, put, cut, key) : polygonBeside(part, put, cut, key, plane, reach);
  });
}

function boxAbove({ box }: Box, put: Put, cut: boolean, key: string): Drawing {
  const corners = cornersOf(box);
  const yaw = ((box.yaw_deg ?? 0) * Math.PI) / 180;
  const middle: Spot = [(box.min[0] + box.max[0]) / 2, (box.min[1] + box.max[1]) / 2];
  const sized = (at: Spot, half: Spot, yaw_deg = box.yaw_deg): Region =>
    put({
      box: {
        min: [cm(at[0] - half[0]), cm(at[1] - half[1]), box.min[2]],
        max: [cm(at[0] + half[0]), cm(at[1] + half[1]), box.max[2]],
        ...(yaw_deg ? { yaw_deg } : {}),
      },
    });
  const half: Spot = [(box.max[0] - box.min[0]) / 2, (box.max[1] - box.min[1]) / 2];
  const handles: Handle[] = corners.map((at, i) => ({
    key: `${key}.c${i}`,
    label: `Corner ${i + 1} of the box`,
    kind: "corner",
    at,
    // The opposite corner stays where it is.
    move: (to) => {
      const fixed = corners[(i + 2) % 4] ?? middle;
      const across = turned([(to[0] - fixed[0]) / 2, (to[1] - fixed[1]) / 2], -yaw);
      const size = across.map((one) => Math.max(SMALLEST_M / 2, Math.abs(one))) as Spot;
      return sized([(to[0] + fixed[0]) / 2, (to[1] + fixed[1]) / 2], size);
    },
  }));
  handles.push(
    { key: `${key}.m`, label: "The box", kind: "middle", at: middle, move: (to) => sized(to, half) },
    {
      key: `${key}.t`,
      label: "Turn the box",
      kind: "turn",
      at: plus(middle, turned([half[0] + 1.2, 0], yaw)),
      move: (to) => sized(middle, half, tenth((Math.atan2(to[1] - middle[1], to[0] - middle[0]) * 180) / Math.PI)),
    },
  );
  return { outlines: [{ spots: corners, closed: true, cut }], handles };
}

function boxBeside({ box }: Box, put: Put, cut: boolean, key: string, plane: Plane): Drawing {
  const [across] = AXES[plane];
  const seen = cornersOf(box).map((corner) => corner[across as 0 | 1]);
  const [left, right] = [Math.min(...seen), Math.max(...seen)];
  const side = (axis: Axis) => (span: Spot) =>
    put({ box: { ...box, min: box.min.with(axis, span[0]) as Point, max: box.max.with(axis, span[1]) as Point } });
  const z: Spot = [box.min[2], box.max[2]];
  const handles = ends(`${key}.z`, "z", "the box", z, (at) => [(left + right) / 2, at], side(2));
  // The sides of a turned box are not seen from here.
  if (!box.yaw_deg) {
    const span: Spot = [box.min[across], box.max[across]];
    handles.push(...ends(`${key}.`, LETTERS[across], "the box", span, (at) => [at, (z[0] + z[1]) / 2], side(across)));
  }
  return { outlines: [rectangle(left, right, z[0], z[1], cut)], handles };
}

function polygonAbove(node: Polygon, put: Put, cut: boolean, key: string): Drawing {
  const corners = node.polygon;
  const made = (polygon: Spot[]): Region => put({ ...node, polygon });
  const handles: Handle[] = corners.map((at, i) => ({
    key: `${key}.c${i}`,
    label: `Corner ${i + 1} of the polygon`,
    kind: "corner",
    at,
    move: (to) => made(corners.with(i, rounded(to))),
    ...(corners.length > 3 ? { remove: () => made(corners.toSpliced(i, 1)) } : {}),
  }));
  if (corners.length < MAX_CORNERS) {
    corners.forEach((corner, i) => {
      const next = corners[(i + 1) % corners.length] ?? corner;
      handles.push({
        key: `${key}.n${i}`,
        label: `New corner after corner ${i + 1}`,
        kind: "new",
        at: [(corner[0] + next[0]) / 2, (corner[1] + next[1]) / 2],
        move: (to) => made(corners.toSpliced(i + 1, 0, rounded(to))),
      });
    });
  }
  const mean = (axis: 0 | 1): number => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length;
  const middle: Spot = [mean(0), mean(1)];
  handles.push({
    key: `${key}.m`,
    label: "The polygon",
    kind: "middle",
    at: middle,
    move: (to) => made(corners.map((corner) => rounded(plus(corner, [to[0] - middle[0], to[1] - middle[1]])))),
  });
  return { outlines: [{ spots: corners, closed: true, cut }], handles };
}

function polygonBeside(node: Polygon, put: Put, cut: boolean, key: string, plane: Plane, reach: Extent): Drawing {
  const seen = node.polygon.map((corner) => corner[AXES[plane][0] as 0 | 1]);
  const [left, right] = [Math.min(...seen), Math.max(...seen)];
  const z: Spot = node.z ?? [reach.min[2], reach.max[2]];
  const handles = ends(
    `${key}.z`,
    "z",
    "the polygon",
    z,
    (at) => [(left + right) / 2, at],
    (z) => put({ ...node, z }),
  );
  return { outlines: [rectangle(left, right, z[0], z[1], cut)], handles };
}

/** Handles of the two ends of a span along an axis; `spot` is where an end lies in the plane. */
function ends(
  key: string,
  axis: string,
  what: string,
  [low, high]: Spot,
  spot: (end: number) => Spot,
  put: (span: Spot) => Region,
): Handle[] {
  const along = (to: Spot): number => to[spot(0)[0] === spot(1)[0] ? 1 : 0];
  const from = (to: Spot): Region => put([cm(Math.min(along(to), high - SMALLEST_M)), high]);
  const until = (to: Spot): Region => put([low, cm(Math.max(along(to), low + SMALLEST_M))]);
  return [
    { key: `${key}min`, label: `${axis} from of ${what}`, kind: "edge", at: spot(low), move: from },
    { key: `${key}max`, label: `${axis} to of ${what}`, kind: "edge", at: spot(high), move: until },
  ];
}

/** The line of an inequality, if this plane shows it as one. */
function limit(node: Inequality, put: Put, key: string, plane: Plane, reach: Extent): Drawing {
  const [a, b] = AXES[plane];
  const [low, high]: [Spot, Spot] = [
    [reach.min[a], reach.min[b]],
    [reach.max[a], reach.max[b]],
  ];
  const label = `${node.quantity}${node.divided_by ? ` / ${node.divided_by}` : ""} ${node.op}`;
  const curve = (spots: Spot[], at: Spot, value: (to: Spot) => number): Drawing => ({
    outlines: [{ spots, closed: false, cut: false }],
    handles: [{ key, label, kind: "edge", at, move: (to) => put({ ...node, value: value(to) }) }],
  });
  const line = (from: Spot, to: Spot, value: (to: Spot) => number): Drawing =>
    curve([from, to], [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2], value);
  const [first, second] = [LETTERS[a], LETTERS[b]];
  const { quantity, value } = node;
  if (node.divided_by) {
    // A line through the LiDAR, along the divisor.
    const far = Math.max(...high.map(Math.abs), ...low.map(Math.abs));
    if (quantity !== second || node.divided_by !== first) return { outlines: [], handles: [] };
    return line([0, 0], [far, value * far], (to) => thousandth(to[1] / (to[0] || SMALLEST_M)));
  }
  if (quantity === first) return line([value, low[1]], [value, high[1]], (to) => cm(to[0]));
  if (quantity === second) return line([low[0], value], [high[0], value], (to) => cm(to[1]));
  if (quantity === "range") {
    const spots = Array.from({ length: 97 }, (_, i) => turned([value, 0], (i * Math.PI) / 48));
    return curve(spots, turned([value, 0], Math.PI / 8), (to) => cm(Math.hypot(...to)));
  }
  const isAngle = plane === "top" ? quantity === "azimuth_deg" : plane === "side" && quantity === "elevation_deg";
  if (!isAngle) return { outlines: [], handles: [] };
  const end = turned([Math.max(high[0], SMALLEST_M), 0], (value * Math.PI) / 180);
  return line([0, 0], end, (to) => tenth((Math.atan2(to[1], to[0]) * 180) / Math.PI));
}

function rectangle(left: number, right: number, low: number, high: number, cut: boolean): Outline {
  const spots = [left, right, right, left].map((x, i): Spot => [x, i < 2 ? low : high]);
  return { spots, closed: true, cut };
}

const plus = (a: Spot, b: Spot): Spot => [a[0] + b[0], a[1] + b[1]];

function turned([x, y]: Spot, angle: number): Spot {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return [x * cos - y * sin, x * sin + y * cos];
}

const cm = (value: number): number => Math.round(value * 100) / 100;
const tenth = (value: number): number => Math.round(value * 10) / 10;
const thousandth = (value: number): number => Math.round(value * 1000) / 1000;
const rounded = (spot: Spot): Spot => [cm(spot[0]), cm(spot[1])];
