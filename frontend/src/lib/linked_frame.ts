/** The camera frame, and perhaps the mark in it, that a link to a recording's page names. */

export interface LinkedFrame {
  index: number;
  mark: { u: number; v: number } | null;
}

/** The frame that `?camera=front&frame=12&u=..&v=..` names, within the camera's own; null if it is another camera's. */
export function linkedFrame(search: URLSearchParams, sensor: { name: string; count: number }): LinkedFrame | null {
  const frame = search.get("frame");
  if (search.get("camera") !== sensor.name || frame === null || !/^\d+$/.test(frame)) return null;
  const u = Number(search.get("u") ?? NaN);
  const v = Number(search.get("v") ?? NaN);
  return {
    index: Math.min(Number(frame), Math.max(0, sensor.count - 1)),
    mark: Number.isFinite(u) && Number.isFinite(v) ? { u, v } : null,
  };
}
