/**
 * A region of interest as the service takes it: inequalities in x, y, z, range and angles, boxes and polygons on the
 * ground; all of some hold, and none of others. The service checks every number; here only the form is checked.
 */

import { every, type Operator, type Quantity } from "./api/types.ts";

export const QUANTITIES = every<Quantity>({ x: 0, y: 0, z: 0, range: 0, azimuth_deg: 0, elevation_deg: 0 });
export const OPERATORS = every<Operator>({ "<": 0, "<=": 0, ">": 0, ">=": 0 });

export interface Inequality {
  quantity: Quantity;
  /** The service leaves null out. */
  divided_by?: Quantity | null;
  op: Operator;
  value: number;
}

export type Point = [number, number, number];

/** Turned by `yaw_deg` about its own upright axis, counter-clockwise seen from above. */
export interface Box {
  box: { min: Point; max: Point; yaw_deg?: number };
}

/** 3 to 64 corners seen from above; without `z` from the ground to the sky. */
export interface Polygon {
  polygon: [number, number][];
  z?: [number, number];
}

export type Part = Inequality | Box | Polygon;

/** All parts of `all` hold and none of `none`. With `up`, in the LiDAR's frame, they are in its level axes. */
export interface Region {
  all: Part[];
  none?: Part[];
  up?: Point;
}

export type Member = "all" | "none";
const MEMBERS: readonly Member[] = ["all", "none"];

export const MAX_CORNERS = 64;

/** The paper's field of 10 x 30 m ahead, with a margin, and without the ground as a roof-mounted LiDAR sees it. */
export const DEFAULT_ROWS: readonly Inequality[] = [
  { quantity: "x", divided_by: null, op: ">", value: 2 },
  { quantity: "x", divided_by: null, op: "<", value: 33 },
  { quantity: "y", divided_by: null, op: ">", value: -6 },
  { quantity: "y", divided_by: null, op: "<", value: 6 },
  { quantity: "z", divided_by: null, op: ">", value: -1.7 },
];

/** The region with other parts in one of its lists; an empty list of what is cut out is left out. */
export function withParts(region: Region, member: Member, parts: Part[]): Region {
  const { none, ...rest } = { ...region, [member]: parts };
  return none?.length ? { ...rest, none } : rest;
}

/** A box's four corners seen from above, turned about its middle. */
export function cornersOf({ min, max, yaw_deg = 0 }: Box["box"]): [number, number][] {
  const [x, y] = [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2];
  const [dx, dy] = [(max[0] - min[0]) / 2, (max[1] - min[1]) / 2];
  const yaw = (yaw_deg * Math.PI) / 180;
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  return [0, 1, 2, 3].map((corner) => {
    const [i, j] = [corner % 3 === 0 ? -1 : 1, corner < 2 ? -1 : 1];
    return [x + i * dx * cos - j * dy * sin, y + i * dx * sin + j * dy * cos];
  });
}

/** The region in words, for lists. */
export function describe({ all, none, up }: Region): string {
  const parts = all.map(describePart).join(" and ");
  const cut = none?.length ? `, without ${none.map(describePart).join(" and ")}` : "";
  return `${up ? "in level axes: " : ""}${parts}${cut}`;
}

function describePart(part: Part): string {
  if ("box" in part) return describeBox(part.box);
  if ("polygon" in part) return describePolygon(part);
  return `${part.quantity}${part.divided_by ? ` / ${part.divided_by}` : ""} ${part.op} ${part.value}`;
}

function describeBox(box: Box["box"]): string {
  const sides = ["x", "y", "z"].map((axis, i) => `${axis} ${String(box.min[i])} to ${String(box.max[i])}`);
  const turned = box.yaw_deg ? `, turned by ${String(box.yaw_deg)}°` : "";
  return `box (${sides.join(", ")}${turned})`;
}

function describePolygon({ polygon, z }: Polygon): string {
  const heights = z ? `, z ${String(z[0])} to ${String(z[1])}` : "";
  return `polygon (${String(polygon.length)} corners${heights})`;
}

/** Reads a region from text. Throws an Error whose message says where it is wrong. */
export function parseRegion(text: string): Region {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch (error) {
    throw new Error(`This is not JSON: ${(error as Error).message}`, { cause: error });
  }
  const given = objectOf(value, "region", '{"all": [parts]}, perhaps with "none": [parts]');
  const stray = Object.keys(given).find((name) => !["all", "none", "up"].includes(name));
  if (stray) throw new Error(`region: it has beside "${stray}".`);
  const [all = [], none = []] = MEMBERS.map((member) => partsOf(given[member] ?? [], `region.${member}`));
  if (all.length === 0) throw new Error("region.all: expected a filled list.");
  const region = withParts({ all }, "none", none);
  if ((given.up ?? null) === null) return region;
  const up = numbers(given.up, 3, "region.up") as Point;
  if (Math.hypot(...up) < SHORTEST) throw new Error("region.up: it has no direction.");
  if (up.some((value) => Math.abs(value) > MOST)) throw new Error(`region.up: no number may be beyond ${MOST}.`);
  return { ...region, up };
}

const SHORTEST = 1e-3;
const MOST = 1e6;

function objectOf(value: unknown, path: string, form: string): Record<string, unknown> {
  const isObject = typeof value === "object" && value !== null && !Array.isArray(value);
  if (!isObject) throw new Error(`${path}: expected ${form}.`);
  return value as Record<string, unknown>;
}

function partsOf(value: unknown, path: string): Part[] {
  if (!Array.isArray(value)) throw new Error(`${path}: expected a list of parts.`);
  return value.map((part: unknown, i) => {
    const at = `${path}[${i}]`;
    const node = objectOf(part, at, "an inequality, a box or a polygon");
    if ("box" in node) return { box: box(node.box, `${at}.box`) };
    return "polygon" in node ? polygon(node, at) : inequality(node, at);
  });
}

function box(value: unknown, path: string): Box["box"] {
  const given = objectOf(value, path, '{"min": [x, y, z], "max": [x, y, z]}, perhaps with "yaw_deg"');
  const min = numbers(given.min, 3, `${path}.min`) as Point;
  const max = numbers(given.max, 3, `${path}.max`) as Point;
  const wrong = ["x", "y", "z"].find((_, i) => !((min[i] ?? NaN) < (max[i] ?? NaN)));
  if (wrong) throw new Error(`${path}: min is not below max in ${wrong}.`);
  const yaw = given.yaw_deg ?? 0;
  if (typeof yaw !== "number") throw new Error(`${path}.yaw_deg: expected a number.`);
  return yaw ? { min, max, yaw_deg: yaw } : { min, max };
}

function polygon(node: Record<string, unknown>, path: string): Polygon {
  const given = node.polygon;
  if (!Array.isArray(given) || given.length < 3 || given.length > MAX_CORNERS) {
    throw new Error(`${path}.polygon: expected a list of 3 to ${String(MAX_CORNERS)} corners [x, y].`);
  }
  const corners = given.map((corner, i) => numbers(corner, 2, `${path}.polygon[${i}]`) as [number, number]);
  const heights = node.z ?? null;
  if (heights === null) return { polygon: corners };
  const z = numbers(heights, 2, `${path}.z`) as [number, number];
  if (!(z[0] < z[1])) throw new Error(`${path}.z: low is not below high.`);
  return { polygon: corners, z };
}

function numbers(value: unknown, count: number, path: string): number[] {
  const given: unknown[] = Array.isArray(value) ? value : [];
  if (given.length !== count || !given.every((item) => typeof item === "number")) {
    throw new Error(`${path}: expected a list of ${String(count)} numbers.`);
  }
  return given;
}

function inequality(node: Record<string, unknown>, path: string): Inequality {
  const quantity = QUANTITIES.find((name) => name === node.quantity);
  if (!quantity) throw new Error(`${path}.quantity: expected one of ${QUANTITIES.join(", ")}.`);
  const divisor = node.divided_by ?? null;
  const dividedBy = QUANTITIES.find((name) => name === divisor) ?? null;
  if (divisor !== null && !dividedBy) throw new Error(`${path}.divided_by: expected null or ${QUANTITIES.join(", ")}.`);
  const op = OPERATORS.find((name) => name === node.op);
  if (!op) throw new Error(`${path}.op: expected one of ${OPERATORS.join(" ")}.`);
  if (typeof node.value !== "number") throw new Error(`${path}.value: expected a number.`);
  return { quantity, divided_by: dividedBy, op, value: node.value };
}
