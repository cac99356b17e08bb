import assert from "node:assert/strict";
import { test } from "node:test";
import {
  fit,
  inside,
  loupeSource,
  middleOf,
  ninth,
  nudge,
  pan,
  shownCell,
  toPixel,
  toView,
  viewOf,
  zoom,
  type Cell,
} from "./pixels.ts";

const image = { width: 640, height: 480 };
const viewport = { width: 1000, height: 480 };

function near(actual: number, expected: number): void {
  assert.ok(Math.abs(actual - expected) < 1e-9, `${actual} is not ${expected}`);
}

test("a click at CSS position p inside the image is p / scale - 0.5", () => {
  const view = { scale: 2, x: 0, y: 0 };
  assert.deepEqual(toPixel(view, { x: 1, y: 1 }), { u: 0, v: 0 });
  assert.deepEqual(toPixel(view, { x: 0, y: 0 }), { u: -0.5, v: -0.5 });
  assert.deepEqual(toPixel(view, { x: 101, y: 41 }), { u: 50, v: 20 });
});

test("MATLAB's labels are 1-based: the same spot minus one", () => {
  // The centre of the top-left pixel is (1, 1) there and lies at CSS 0.5 of an unscaled image.
  const pixel = toPixel({ scale: 1, x: 0, y: 0 }, { x: 0.5, y: 0.5 });
  assert.deepEqual({ u: 1 - 1, v: 1 - 1 }, pixel);
});

test("view and pixel are each other's inverse", () => {
  const view = { scale: 3.7, x: -120.25, y: 44.5 };
  const back = toPixel(view, toView(view, { u: 12.34, v: 56.78 }));
  near(back.u, 12.34);
  near(back.v, 56.78);
});

test("fit shows the whole image, centred", () => {
  assert.deepEqual(fit(image, viewport), { scale: 1, x: 180, y: 0 });
  assert.deepEqual(fit(image, { width: 320, height: 480 }), { scale: 0.5, x: 0, y: 120 });
});

test("zooming keeps the point under the cursor", () => {
  const start = fit(image, viewport);
  const anchor = { x: 500, y: 200 };
  const before = toPixel(start, anchor);
  const after = toPixel(zoom(start, 5, anchor, image, viewport), anchor);
  near(after.u, before.u);
  near(after.v, before.v);
});

test("zooming out ends at the whole image", () => {
  const start = fit(image, viewport);
  const large = zoom(start, 8, { x: 300, y: 100 }, image, viewport);
  assert.deepEqual(zoom(large, 1e-3, { x: 700, y: 400 }, image, viewport), start);
});

test("a pan never leaves the viewport empty", () => {
  const large = zoom(fit(image, viewport), 4, { x: 500, y: 240 }, image, viewport);
  const moved = pan(large, 1e5, -1e5, image, viewport);
  assert.equal(moved.x, 0);
  assert.equal(moved.y, viewport.height - image.height * 4);
});

test("the image ends half a pixel outside its outermost pixel centres", () => {
  assert.ok(inside({ u: -0.5, v: -0.5 }, image));
  assert.ok(inside({ u: 639.5, v: 479.5 }, image));
  assert.ok(!inside({ u: 639.51, v: 0 }, image));
  assert.ok(!inside({ u: 0, v: -0.51 }, image));
});

test("a nudge stops at the edge", () => {
  assert.deepEqual(nudge({ u: 639.4, v: 3 }, 1, -0.5, image), { u: 639.5, v: 2.5 });
});

test("the loupe's centre is the pixel's centre", () => {
  // 160 CSS pixels at 8 times show 20 image pixels; pixel (0, 0) has its centre at (0.5, 0.5) of drawImage.
  assert.deepEqual(loupeSource({ u: 0, v: 0 }, 160, 8), { x: -9.5, y: -9.5, side: 20 });
});

test("the keys of a keypad are the ninths of what is shown", () => {
  const whole = shownCell(fit(image, viewport), image, viewport);
  assert.deepEqual(whole, { left: -0.5, top: -0.5, width: 640, height: 480 });
  assert.deepEqual(middleOf(ninth(whole, 5)), { u: 319.5, v: 239.5 });
  assert.deepEqual(ninth(whole, 7), { left: -0.5, top: -0.5, width: 640 / 3, height: 160 });
  const last = ninth(whole, 3);
  near(last.left + last.width, 639.5);
  near(last.top + last.height, 479.5);
});

test("seven keys lead to any pixel within 0.2 px, and show it", () => {
  for (const wanted of [
    { u: 0, v: 0 },
    { u: 517.3, v: 44.9 },
    { u: 639, v: 479 },
  ]) {
    let cell: Cell = shownCell(fit(image, viewport), image, viewport);
    for (let turn = 0; turn < 7; turn += 1) {
      const column = Math.min(2, Math.floor((3 * (wanted.u - cell.left)) / cell.width));
      const row = Math.min(2, Math.floor((3 * (wanted.v - cell.top)) / cell.height));
      cell = ninth(cell, 7 - 3 * row + column);
    }
    const found = middleOf(cell);
    assert.ok(Math.abs(found.u - wanted.u) < 0.2 && Math.abs(found.v - wanted.v) < 0.2, JSON.stringify(found));
    const at = toView(viewOf(cell, image, viewport), found);
    assert.ok(at.x >= 0 && at.x <= viewport.width && at.y >= 0 && at.y <= viewport.height);
  }
});
