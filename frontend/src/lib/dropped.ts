/** Files that were dropped or chosen on one page and are used on another: a recording, and perhaps a URDF beside it. */

interface Dropped {
  vehicleId: string;
  /** The rig that it belongs to, if that is known. */
  rigId: string | null;
  files: FileList;
}

let carried: Dropped | null = null;
/** The text of the URDF that was given with a recording, by the recording's id; until the page is loaded anew. */
const urdfs = new Map<string, string>();

export function carry(dropped: Dropped): void {
  carried = dropped;
}

/** What was dropped for a vehicle; once. */
export function taken(vehicleId: string): Dropped | null {
  const found = carried?.vehicleId === vehicleId ? carried : null;
  carried = null;
  return found;
}

const isUrdf = (file: File): boolean => /\.(urdf|xml)$/i.test(file.name);

/** The recording among some files: the first that is no URDF. */
export const recordingIn = (files: FileList | null | undefined): File | undefined =>
  [...(files ?? [])].find((file) => !isUrdf(file));

/** Keeps the URDF among some files for the rig of a recording. */
export async function keepUrdf(recordingId: string, files: FileList | undefined): Promise<void> {
  const urdf = [...(files ?? [])].find(isUrdf);
  if (urdf) urdfs.set(recordingId, await urdf.text());
}

export const urdfOf = (recordingId: string): string | null => urdfs.get(recordingId) ?? null;

/** A vehicle's name after a recording's file. */
export const nameAfter = (file: File): string => file.name.replace(/\.[A-Za-z0-9.]{1,10}$/, "") || file.name;
