import assert from "node:assert/strict";
import { test } from "node:test";
import type { Sweep } from "../points/sweep.ts";
import { projectionOf, type Mount } from "./projection.ts";
import { visibleOf } from "./visible.ts";

const SIZE = { width: 640, height: 480 };
const project = projectionOf({ model: "pinhole", f_x: 400, f_y: 400, c_x: 319.5, c_y: 239.5 });
/** A camera that looks along the LiDAR's x, moved by metres in its own frame. */
const mount = (...translation: [number, number, number]): Mount => ({
  rotation: [
    [0, -1, 0],
    [0, 0, -1],
    [1, 0, 0],
  ],
  translation,
});

const RINGS = 32;
const COLUMNS = 720;

/** A wall 20 m ahead and behind, with a panel 2 m wide and high 5 m ahead, of `RINGS` x `COLUMNS` points. */
function room(): Sweep {
  const positions = new Float32Array(3 * RINGS * COLUMNS);
  const rings = new Uint16Array(RINGS * COLUMNS);
  for (let i = 0; i < RINGS * COLUMNS; i += 1) {
    const ring = Math.floor(i / COLUMNS);
    const azimuth = -Math.PI + (2 * Math.PI * ((i % COLUMNS) + 0.5)) / COLUMNS;
    const elevation = ((ring - (RINGS - 1) / 2) * Math.PI) / 180;
    const ray = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
    const ahead = ray[0] ?? 0;
    const at = (range: number): number[] => ray.map((one) => one * range);
    const panel = at(5 / Math.max(1e-9, ahead));
    const onPanel = ahead > 0 && Math.abs(panel[1] ?? 0) < 1 && Math.abs(panel[2] ?? 0) < 1;
    positions.set(onPanel ? panel : at(20 / Math.max(0.05, Math.abs(ahead))), 3 * i);
    rings[i] = ring;
  }
  const count = RINGS * COLUMNS;
  return {
    count,
    ringCount: RINGS,
    positions,
    rings,
    intensities: new Float32Array(count),
    timesNs: new Float64Array(count),
  };
}

test("what is behind the camera or outside of the image is left out, and the rest is where it projects", () => {
  const sweep = room();
  const seen = visibleOf(sweep, mount(0, 0, 0), project, SIZE);
  let inside = 0;
  const pixel = { u: 0, v: 0 };
  for (let i = 0; i < sweep.count; i += 1) {
    const [x = 0, y = 0, z = 0] = sweep.positions.subarray(3 * i, 3 * i + 3);
    if (!project(-y, -z, x, pixel)) continue;
    if (pixel.u > -0.5 && pixel.u < 639.5 && pixel.v > -0.5 && pixel.v < 479.5) inside += 1;
  }
  // From the LiDAR's own place nothing is hidden: each of its rays ends at the first surface.
  assert.equal(seen.hidden, 0);
  assert.equal(seen.count, inside);
  assert.ok(inside > 1000);
});

test("from aside the panel hides the wall behind it, and no other point", () => {
  const sweep = room();
  const aside = 0.5; // metres to the left of the LiDAR
  const seen = visibleOf(sweep, mount(aside, 0, 0), project, SIZE);
  // Where the rays from the camera through the panel's edges meet the wall.
  const shadow = (edge: number): number => aside + ((edge - aside) * 20) / 5;
  const [left, right] = [shadow(1), shadow(-1)];
  let wrong = 0;
  let behind = 0;
  for (let i = 0; i < seen.count; i += 1) {
    const y = aside - (((seen.u[i] ?? 0) - 319.5) * 20) / 400;
    const z = -(((seen.v[i] ?? 0) - 239.5) * 20) / 400;
    if ((seen.distance[i] ?? 0) < 10) continue;
    behind += 1;
    // Two degrees of the wall about the edges are left to the patches' size.
    if (y < left - 0.7 && y > right + 0.7 && Math.abs(z) < 4 - 0.7) wrong += 1;
  }
  assert.ok(seen.hidden > 50, `${seen.hidden}`);
  assert.ok(behind > 1000);
  assert.equal(wrong, 0);
  const panel = [...seen.distance].filter((one) => one < 10).length;
  const all = visibleOf(sweep, mount(0, 0, 0), project, SIZE);
  assert.equal(panel, [...all.distance].filter((one) => one < 10).length);
});
