/**
 * A region of interest as the service takes it: inequalities in x, y, z, range and angles, boxes and polygons on the
 * ground, combined by and / or / not. The service checks every number; here only the form is checked.
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

export type Leaf = Inequality | Box | Polygon;
export type Region = { and: Region[] } | { or: Region[] } | { not: Region } | Leaf;

/** A whole region in the level axes of a tilted LiDAR; `up` is in the LiDAR's frame. */
export interface Level {
  level: Region;
  up: Point;
}

export type WholeRegion = Region | Level;

/** The tree of a region, and up where it is in level axes. */
export function levelOf(region: WholeRegion): { tree: Region; up: Point | null } {
  return "level" in region ? { tree: region.level, up: region.up } : { tree: region, up: null };
}

/** A tree as a whole region again. */
export function wholeOf(tree: Region, up: Point | null): WholeRegion {
  return up ? { level: tree, up } : tree;
}

export const MAX_CORNERS = 64;

/** The paper's field of 10 x 30 m ahead, with a margin, and without the ground as a roof-mounted LiDAR sees it. */
export const DEFAULT_ROWS: readonly Inequality[] = [
  { quantity: "x", divided_by: null, op: ">", value: 2 },
  { quantity: "x", divided_by: null, op: "<", value: 33 },
  { quantity: "y", divided_by: null, op: ">", value: -6 },
  { quantity: "y", divided_by: null, op: "<", value: 6 },
  { quantity: "z", divided_by: null, op: ">", value: -1.7 },
];

/** A line of the list of parts that all must hold: a leaf, or a cut-out. */
export type Part = Leaf | { not: Leaf };

/** The parts of a region that is a plain list of parts that all hold, else null. */
export function partsOf(region: Region): Part[] | null {
  if (isPart(region)) return [region];
  if (!("and" in region) || !region.and.every(isPart)) return null;
  return [...region.and];
}

function isPart(node: Region): node is Part {
  return isLeaf(node) || ("not" in node && isLeaf(node.not));
}

/** The region with one more part that must hold. */
export function withPart(region: Region, part: Part): Region {
  return { and: [...("and" in region ? region.and : [region]), part] };
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
export function describe(region: unknown): string {
  if (typeof region !== "object" || region === null) return "";
  const node = region as Record<string, unknown>;
  for (const word of ["and", "or"] as const) {
    const children = node[word];
    if (Array.isArray(children)) {
      return children.map((child) => (isLeaf(child) ? describe(child) : `(${describe(child)})`)).join(` ${word} `);
    }
  }
  if ("not" in node) return `not (${describe(node.not)})`;
  if ("level" in node) return `in level axes: ${describe(node.level)}`;
  if ("box" in node) return describeBox((node as unknown as Box).box);
  if ("polygon" in node) return describePolygon(node as unknown as Polygon);
  const { quantity, divided_by, op, value } = node as unknown as Inequality;
  return `${quantity}${divided_by ? ` / ${divided_by}` : ""} ${op} ${value}`;
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

function isLeaf(node: unknown): node is Leaf {
  return typeof node === "object" && node !== null && ("quantity" in node || "box" in node || "polygon" in node);
}

/** Reads a region from text. Throws an Error whose message says where it is wrong. */
export function parseRegion(text: string): WholeRegion {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch (error) {
    throw new Error(`This is not JSON: ${(error as Error).message}`, { cause: error });
  }
  if (typeof value !== "object" || value === null || !("level" in value)) return checked(value, "region");
  const up = numbers("up" in value ? value.up : null, 3, "region.up") as Point;
  if (Math.hypot(...up) < SHORTEST) throw new Error("region.up: it has no direction.");
  if (up.some((value) => Math.abs(value) > MOST)) throw new Error(`region.up: no number may be beyond ${MOST}.`);
  return { level: checked(value.level, "region.level"), up };
}

const SHORTEST = 1e-3;
const MOST = 1e6;

function checked(value: unknown, path: string): Region {
  if (typeof value !== "object" || value === null || Array.isArray(value)) {
    throw new Error(
      `${path}: expected {"and": [...]}, {"or": [...]}, {"not": ...}, a box, a polygon or an inequality.`,
    );
  }
  const node = value as Record<string, unknown>;
  for (const word of ["and", "or"] as const) {
    const children = node[word];
    if (children === undefined) continue;
    if (!Array.isArray(children) || children.length === 0) throw new Error(`${path}.${word}: expected a filled list.`);
    const list = children.map((child, index) => checked(child, `${path}.${word}[${index}]`));
    return word === "and" ? { and: list } : { or: list };
  }
  if ("not" in node) return { not: checked(node.not, `${path}.not`) };
  if ("box" in node) return { box: box(node.box, `${path}.box`) };
  if ("polygon" in node) return polygon(node, path);
  if ("level" in node) throw new Error(`${path}: only a whole region may be in level axes.`);
  return inequality(node, path);
}

function box(value: unknown, path: string): Box["box"] {
  if (typeof value !== "object" || value === null) {
    throw new Error(`${path}: expected {"min": [x, y, z], "max": [x, y, z]}, perhaps with "yaw_deg".`);
  }
  const given = value as Record<string, unknown>;
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
