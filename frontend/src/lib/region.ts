/**
 * A region of interest as the service takes it: inequalities in x, y, z, range and angles, combined by and / or.
 * The editor works on rows that all hold; anything deeper is edited as JSON.
 */

export const QUANTITIES = ["x", "y", "z", "range", "azimuth_deg", "elevation_deg"] as const;
export const OPERATORS = ["<", "<=", ">", ">="] as const;

export type Quantity = (typeof QUANTITIES)[number];
export type Operator = (typeof OPERATORS)[number];

export interface Inequality {
  quantity: Quantity;
  divided_by: Quantity | null;
  op: Operator;
  value: number;
}

export type Region = { and: Region[] } | { or: Region[] } | Inequality;

/** The paper's field of 10 x 30 m ahead, with a margin, and without the ground as a roof-mounted LiDAR sees it. */
export const DEFAULT_ROWS: readonly Inequality[] = [
  { quantity: "x", divided_by: null, op: ">", value: 2 },
  { quantity: "x", divided_by: null, op: "<", value: 33 },
  { quantity: "y", divided_by: null, op: ">", value: -6 },
  { quantity: "y", divided_by: null, op: "<", value: 6 },
  { quantity: "z", divided_by: null, op: ">", value: -1.7 },
];

export function regionOf(rows: readonly Inequality[]): Region {
  return { and: rows.map((row) => ({ ...row })) };
}

/** The rows of a region that is a plain list of inequalities that all hold, else null. */
export function rowsOf(region: Region): Inequality[] | null {
  if ("quantity" in region) return [{ ...region }];
  if (!("and" in region)) return null;
  const rows: Inequality[] = [];
  for (const node of region.and) {
    if (!("quantity" in node)) return null;
    rows.push({ ...node });
  }
  return rows;
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
  const divided = node["divided_by"] ? ` / ${String(node["divided_by"])}` : "";
  return `${String(node["quantity"])}${divided} ${String(node["op"])} ${String(node["value"])}`;
}

function isLeaf(node: unknown): boolean {
  return typeof node === "object" && node !== null && "quantity" in node;
}

/** Reads a region from text. Throws an Error whose message says where it is wrong. */
export function parseRegion(text: string): Region {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch (error) {
    throw new Error(`This is not JSON: ${(error as Error).message}`);
  }
  return checked(value, "region");
}

function checked(value: unknown, path: string): Region {
  if (typeof value !== "object" || value === null || Array.isArray(value)) {
    throw new Error(`${path}: expected {"and": [...]}, {"or": [...]} or an inequality.`);
  }
  const node = value as Record<string, unknown>;
  for (const word of ["and", "or"] as const) {
    const children = node[word];
    if (children === undefined) continue;
    if (!Array.isArray(children) || children.length === 0) throw new Error(`${path}.${word}: expected a filled list.`);
    const list = children.map((child, index) => checked(child, `${path}.${word}[${index}]`));
    return word === "and" ? { and: list } : { or: list };
  }
  return inequality(node, path);
}

function inequality(node: Record<string, unknown>, path: string): Inequality {
  const quantity = QUANTITIES.find((name) => name === node["quantity"]);
  if (!quantity) throw new Error(`${path}.quantity: expected one of ${QUANTITIES.join(", ")}.`);
  const divisor = node["divided_by"] ?? null;
  const dividedBy = QUANTITIES.find((name) => name === divisor) ?? null;
  if (divisor !== null && !dividedBy) throw new Error(`${path}.divided_by: expected null or ${QUANTITIES.join(", ")}.`);
  const op = OPERATORS.find((name) => name === node["op"]);
  if (!op) throw new Error(`${path}.op: expected one of ${OPERATORS.join(" ")}.`);
  if (typeof node["value"] !== "number") throw new Error(`${path}.value: expected a number.`);
  return { quantity, divided_by: dividedBy, op, value: node["value"] };
}
