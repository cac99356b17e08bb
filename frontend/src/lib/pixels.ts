/**
 * Coordinates of a zoomed image. Two systems:
 *  - view: CSS pixels from the top-left corner of the viewport element;
 *  - pixel (u, v): OpenCV's convention, (0, 0) is the centre of the image's top-left pixel.
 * The image's top-left corner therefore lies at pixel (-0.5, -0.5).
 */

export interface Point {
  x: number;
  y: number;
}

export interface Pixel {
  u: number;
  v: number;
}

export interface Size {
  width: number;
  height: number;
}

/** How an image lies in its viewport: its top-left corner at (x, y), one image pixel `scale` CSS pixels wide. */
export interface View {
  scale: number;
  x: number;
  y: number;
}

export const MAX_SCALE = 32;

export function toPixel(view: View, point: Point): Pixel {
  return { u: (point.x - view.x) / view.scale - 0.5, v: (point.y - view.y) / view.scale - 0.5 };
}

export function toView(view: View, pixel: Pixel): Point {
  return { x: (pixel.u + 0.5) * view.scale + view.x, y: (pixel.v + 0.5) * view.scale + view.y };
}

/** The largest view that shows the whole image, centred. */
export function fit(image: Size, viewport: Size): View {
  const scale = Math.min(viewport.width / image.width, viewport.height / image.height, MAX_SCALE);
  return {
    scale,
    x: (viewport.width - image.width * scale) / 2,
    y: (viewport.height - image.height * scale) / 2,
  };
}

/** Zoom by `factor` so that the image point under `anchor` stays there; never smaller than the whole image. */
export function zoom(view: View, factor: number, anchor: Point, image: Size, viewport: Size): View {
  const least = fit(image, viewport).scale;
  const scale = Math.min(Math.max(view.scale * factor, least), Math.max(MAX_SCALE, least));
  const ratio = scale / view.scale;
  const moved = { scale, x: anchor.x - (anchor.x - view.x) * ratio, y: anchor.y - (anchor.y - view.y) * ratio };
  return hold(moved, image, viewport);
}

export function pan(view: View, dx: number, dy: number, image: Size, viewport: Size): View {
  return hold({ ...view, x: view.x + dx, y: view.y + dy }, image, viewport);
}

/** Keeps the image over the viewport where it is larger, and centred where it is smaller. */
function hold(view: View, image: Size, viewport: Size): View {
  return {
    scale: view.scale,
    x: held(view.x, image.width * view.scale, viewport.width),
    y: held(view.y, image.height * view.scale, viewport.height),
  };
}

function held(start: number, length: number, room: number): number {
  if (length <= room) return (room - length) / 2;
  return Math.min(0, Math.max(room - length, start));
}

/** Whether a pixel lies on the image, its edges included. */
export function inside(pixel: Pixel, image: Size): boolean {
  return pixel.u >= -0.5 && pixel.v >= -0.5 && pixel.u <= image.width - 0.5 && pixel.v <= image.height - 0.5;
}

/** The pixel moved by (du, dv), no further than the image's edge. */
export function nudge(pixel: Pixel, du: number, dv: number, image: Size): Pixel {
  return {
    u: Math.min(image.width - 0.5, Math.max(-0.5, pixel.u + du)),
    v: Math.min(image.height - 0.5, Math.max(-0.5, pixel.v + dv)),
  };
}

/** The source rectangle, in the units of drawImage, that a square loupe of `size` CSS pixels shows about a pixel. */
export function loupeSource(
  centre: Pixel,
  size: number,
  magnification: number,
): { x: number; y: number; side: number } {
  const side = size / magnification;
  return { x: centre.u + 0.5 - side / 2, y: centre.v + 0.5 - side / 2, side };
}

/** A rectangle of the image, in pixels as above. */
export interface Cell {
  left: number;
  top: number;
  width: number;
  height: number;
}

/** What of the image the viewport shows. */
export function shownCell(view: View, image: Size, viewport: Size): Cell {
  const from = toPixel(view, { x: 0, y: 0 });
  const to = toPixel(view, { x: viewport.width, y: viewport.height });
  const left = Math.max(-0.5, from.u);
  const top = Math.max(-0.5, from.v);
  const width = Math.min(image.width - 0.5, to.u) - left;
  return { left, top, width, height: Math.min(image.height - 0.5, to.v) - top };
}

/** One of a cell's nine parts, by its key of a keypad: 7 8 9 above, 1 2 3 below. */
export function ninth({ left, top, width, height }: Cell, key: number): Cell {
  const column = (key - 1) % 3;
  const row = 2 - Math.floor((key - 1) / 3);
  return { left: left + (column * width) / 3, top: top + (row * height) / 3, width: width / 3, height: height / 3 };
}

export const middleOf = ({ left, top, width, height }: Cell): Pixel => ({ u: left + width / 2, v: top + height / 2 });

/** The view that shows a cell as large as it goes, with the cell's middle in the viewport's. */
export function viewOf(cell: Cell, image: Size, viewport: Size): View {
  const least = fit(image, viewport).scale;
  const most = Math.max(MAX_SCALE, least);
  const scale = Math.min(most, Math.max(least, Math.min(viewport.width / cell.width, viewport.height / cell.height)));
  const { u, v } = middleOf(cell);
  const start = { scale, x: viewport.width / 2 - (u + 0.5) * scale, y: viewport.height / 2 - (v + 0.5) * scale };
  return pan(start, 0, 0, image, viewport);
}
