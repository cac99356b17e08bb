/** Files that were dropped or chosen on one page and are used on another: a recording, a URDF or a lens beside it. */

interface Dropped {
  vehicleId: string;
  /** The rig that it belongs to, if that is known. */
  rigId: string | null;
  files: FileList;
}

let carried: Dropped | null = null;
/** The text of the URDF that was given with a recording, by the recording's id; until the page is loaded anew. */
const urdfs = new Map<string, string>();
const lenses = new Map<string, File>();

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

const isLens = (file: File): boolean => /\.ya?ml$/i.test(file.name);

/** The recording among some files: the first that is no URDF and no lens. */
export const recordingIn = (files: FileList | null | undefined): File | undefined =>
  [...(files ?? [])].find((file) => !isUrdf(file) && !isLens(file));

/** Keeps the URDF and the lens among some files for the rig of a recording. */
export async function keepBeside(recordingId: string, files: FileList | undefined): Promise<void> {
  const [urdf, lens] = [isUrdf, isLens].map((is) => [...(files ?? [])].find(is));
  if (lens) lenses.set(recordingId, lens);
  if (urdf) urdfs.set(recordingId, await urdf.text());
}

export const lensOf = (recordingId: string): File | undefined => lenses.get(recordingId);

export const urdfOf = (recordingId: string): string | null => urdfs.get(recordingId) ?? null;

/** A vehicle's name after a recording's file. */
export const nameAfter = (file: File): string => file.name.replace(/\.[A-Za-z0-9.]{1,10}$/, "") || file.name;
