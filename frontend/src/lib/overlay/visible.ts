/**
 * Which points of a sweep a camera sees, and where.
 * vectors.json holds it to what NumPy computes of the same cases.
 */

import type { Sweep } from "../points/sweep.ts";
import type { Mount, Project } from "./projection.ts";

export interface Visible {
  count: number;
  /** Pixels and metres from the camera. */
  u: Float64Array;
  v: Float64Array;
  distance: Float32Array;
  /** Points of the sweep that the image holds, but something nearer hides. */
  hidden: number;
}

export interface Size {
  width: number;
  height: number;
}

/** A surface that a ray meets at up to 80 degrees from its normal does not hide itself. */
const SLANT = Math.tan((80 * Math.PI) / 180);
const MOST_CELLS_ACROSS = 512;

/**
 * Each point stands for a patch of half the way to its neighbours in the sweep. A point is hidden if a patch covers it
 * that is nearer to the camera by more than the patch may be deep.
 */
export function visibleOf(sweep: Sweep, mount: Mount, project: Project, size: Size): Visible {
  const cell = Math.max(1, size.width / MOST_CELLS_ACROSS);
  const grid = new DepthGrid(Math.ceil(size.width / cell), Math.ceil(size.height / cell));
  const place = (): Float64Array<ArrayBuffer> => new Float64Array(sweep.count);
  const seen = { count: 0, u: place(), v: place(), distance: new Float32Array(sweep.count) };
  const { azimuth, elevation } = spacingOf(sweep);
  const see = seeing(mount, project);
  const pixel = { u: 0, v: 0 };
  const beside = { u: 0, v: 0 };
  const positions = sweep.positions;
  for (let i = 0; i < sweep.count; i += 1) {
    const x = positions[3 * i] ?? 0;
    const y = positions[3 * i + 1] ?? 0;
    const z = positions[3 * i + 2] ?? 0;
    const distance = see(x, y, z, pixel);
    const { u, v } = pixel;
    // Pixels have (0, 0) at the centre of the first one.
    if (!(distance > 0 && u > -0.5 && v > -0.5 && u < size.width - 0.5 && v < size.height - 0.5)) continue;
    const level = Math.hypot(x, y);
    const range = Math.hypot(level, z);
    const across = (range * azimuth) / 2;
    const up = (range * (elevation[sweep.rings[i] ?? 0] ?? 0)) / 2;
    let reachU = 0;
    let reachV = 0;
    // The patch's half axes, along the ring and from ring to ring, as the camera sees them.
    if (level > 0 && see(x - (y / level) * across, y + (x / level) * across, z, beside) > 0) {
      reachU += Math.abs(beside.u - u);
      reachV += Math.abs(beside.v - v);
    }
    const tilt = (z * up) / (level * range);
    if (level > 0 && see(x - x * tilt, y - y * tilt, z + (level / range) * up, beside) > 0) {
      reachU += Math.abs(beside.u - u);
      reachV += Math.abs(beside.v - v);
    }
    const limit = distance + SLANT * Math.max(across, up);
    grid.cover((u + 0.5) / cell, (v + 0.5) / cell, reachU / cell, reachV / cell, limit);
    seen.u[seen.count] = u;
    seen.v[seen.count] = v;
    seen.distance[seen.count] = distance;
    seen.count += 1;
  }
  return unhidden(seen, grid, cell);
}

/** Puts a point's pixel into the last argument. Returns its distance from the camera, 0 where none is seen. */
function seeing({ rotation: [a, b, c], translation: [tx, ty, tz] }: Mount, project: Project) {
  return (x: number, y: number, z: number, pixel: { u: number; v: number }): number => {
    const cx = a[0] * x + a[1] * y + a[2] * z + tx;
    const cy = b[0] * x + b[1] * y + b[2] * z + ty;
    const cz = c[0] * x + c[1] * y + c[2] * z + tz;
    return project(cx, cy, cz, pixel) ? Math.sqrt(cx * cx + cy * cy + cz * cz) : 0;
  };
}

function unhidden(seen: Omit<Visible, "hidden">, grid: DepthGrid, cell: number): Visible {
  const all = seen.count;
  let count = 0;
  for (let i = 0; i < all; i += 1) {
    const u = seen.u[i] ?? 0;
    const v = seen.v[i] ?? 0;
    const distance = seen.distance[i] ?? 0;
    if (distance > grid.at((u + 0.5) / cell, (v + 0.5) / cell)) continue;
    seen.u[count] = u;
    seen.v[count] = v;
    seen.distance[count] = distance;
    count += 1;
  }
  return {
    count,
    u: seen.u.subarray(0, count),
    v: seen.v.subarray(0, count),
    distance: seen.distance.subarray(0, count),
    hidden: all - count,
  };
}

/** In each cell the distance beyond which points are hidden. */
class DepthGrid {
  readonly #width: number;
  readonly #height: number;
  readonly #limits: Float32Array;

  constructor(width: number, height: number) {
    this.#width = width;
    this.#height = height;
    this.#limits = new Float32Array(width * height).fill(Infinity);
  }

  cover(u: number, v: number, reachU: number, reachV: number, limit: number): void {
    const left = Math.max(0, Math.floor(u - reachU));
    const right = Math.min(this.#width - 1, Math.floor(u + reachU));
    const top = Math.max(0, Math.floor(v - reachV));
    const bottom = Math.min(this.#height - 1, Math.floor(v + reachV));
    const limits = this.#limits;
    for (let row = top; row <= bottom; row += 1) {
      for (let at = row * this.#width + left; at <= row * this.#width + right; at += 1) {
        if ((limits[at] ?? 0) > limit) limits[at] = limit;
      }
    }
  }

  at(u: number, v: number): number {
    return this.#limits[Math.floor(v) * this.#width + Math.floor(u)] ?? Infinity;
  }
}

/** Angles between neighbours: along a ring, and from each ring to the farther one of its neighbours. */
function spacingOf({ count, positions, rings, ringCount }: Sweep): { azimuth: number; elevation: Float64Array } {
  const sums = new Float64Array(ringCount);
  const counts = new Float64Array(ringCount);
  const steps: number[] = [];
  let before = NaN;
  for (let i = 0; i < count; i += 1) {
    const x = positions[3 * i] ?? 0;
    const y = positions[3 * i + 1] ?? 0;
    const z = positions[3 * i + 2] ?? 0;
    const ring = rings[i] ?? 0;
    sums[ring] = (sums[ring] ?? 0) + Math.atan2(z, Math.hypot(x, y));
    counts[ring] = (counts[ring] ?? 0) + 1;
    const azimuth = Math.atan2(y, x);
    const step = Math.abs(azimuth - before);
    if (i > 0 && rings[i - 1] === ring && step > 0) steps.push(step);
    before = azimuth;
  }
  const elevation = new Float64Array(ringCount);
  const filled = [...sums.keys()].filter((ring) => (counts[ring] ?? 0) > 0);
  const mean = (ring: number | undefined): number =>
    ring === undefined ? NaN : (sums[ring] ?? 0) / (counts[ring] ?? 1);
  filled.sort((a, b) => mean(a) - mean(b));
  filled.forEach((ring, i) => {
    const gaps = [mean(ring) - mean(filled[i - 1]), mean(filled[i + 1]) - mean(ring)].filter(
      (gap) => !Number.isNaN(gap),
    );
    elevation[ring] = Math.max(0, ...gaps);
  });
  return { azimuth: median(steps), elevation };
}

function median(values: number[]): number {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.floor(sorted.length / 2)] ?? 0;
}
