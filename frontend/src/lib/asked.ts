/** What a link to a recording's page asks to be shown: a camera's frame, and perhaps a mark in it. */

export interface AskedFrame {
  index: number;
  mark: { u: number; v: number } | null;
}

/** The frame that `?camera=front&frame=12&u=..&v=..` asks for, inside the camera's own; null where it is of another. */
export function askedFrame(search: URLSearchParams, sensor: { name: string; count: number }): AskedFrame | null {
  const frame = search.get("frame");
  if (search.get("camera") !== sensor.name || frame === null || !/^\d+$/.test(frame)) return null;
  const u = Number(search.get("u") ?? NaN);
  const v = Number(search.get("v") ?? NaN);
  return {
    index: Math.min(Number(frame), Math.max(0, sensor.count - 1)),
    mark: Number.isFinite(u) && Number.isFinite(v) ? { u, v } : null,
  };
}
