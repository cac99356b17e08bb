/** A file that was dropped on one page and is uploaded on the page of its vehicle. */

interface Dropped {
  vehicleId: string;
  /** The rig that it belongs to, if that is known. */
  rigId: string | null;
  files: FileList;
}

let carried: Dropped | null = null;

export function carry(dropped: Dropped): void {
  carried = dropped;
}

/** What was dropped for a vehicle; once. */
export function taken(vehicleId: string): Dropped | null {
  const found = carried?.vehicleId === vehicleId ? carried : null;
  carried = null;
  return found;
}
