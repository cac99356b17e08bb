/** Files that were dropped or chosen on one page and are used on another: a recording, a URDF or a lens beside it. */

import { store } from "./drafts.ts";
import { tarOf, type Entry } from "./tar.ts";

type FileEntry = Entry & { file: File };

interface Dropped {
  vehicleId: string;
  /** The rig that it belongs to, if that is known. */
  rigId: string | null;
  files: FileList;
}

let carried: Dropped | null = null;
/** Files beside recordings that stay in the browser, each as its name and text: what is given once is not asked again. */
const BESIDE = "apexcal.beside.";
/** So many; the oldest goes. */
const MOST = 8;

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

/** Names of files in a recording's folder that may state a lens, as `apexcal upload` looks for them. */
const OF_LENSES = /camera|calib|intrin|camchain|lens/i;

// A ROS 2 bag's metadata.yaml is a part of it.
const isLens = (file: File): boolean => /\.ya?ml$/i.test(file.name) && file.name !== "metadata.yaml";

/** The recording among some files: what is no URDF and no lens. Several are one tar: a `.db3` and its `-wal`, parts. */
export function recordingIn(files: FileList | null | undefined): File | undefined {
  const parts = [...(files ?? [])].filter((file) => !isUrdf(file) && !isLens(file));
  const [first] = parts;
  if (!first || parts.length === 1) return first;
  const entries = parts.map((file) => ({ path: file.name, file }));
  return tarOf(entries, nameAfter(first));
}

/** What was dropped, each folder as one tar, and beside it the URDF and the lens that lie in it. */
export async function droppedFiles(data: DataTransfer): Promise<FileList> {
  const roots = [...data.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  const loose = [...data.files];
  if (!roots.some((entry) => entry.isDirectory)) return data.files;
  const whole = new DataTransfer();
  for (const [index, root] of roots.entries()) {
    const below = root.isDirectory ? await filesBelow(root) : [];
    const file = root.isDirectory ? tarOf(below, root.name) : loose[index];
    const beside = below
      .map((entry) => entry.file)
      .filter((each) => /\.urdf$/i.test(each.name) || (isLens(each) && OF_LENSES.test(each.name)));
    for (const each of [file, ...beside]) if (each) whole.items.add(each);
  }
  return whole.files;
}

async function filesBelow(entry: FileSystemEntry): Promise<FileEntry[]> {
  if (entry.name.startsWith(".")) return [];
  if (entry.isFile) {
    const file = await new Promise<File>((good, bad) => (entry as FileSystemFileEntry).file(good, bad));
    return [{ path: entry.fullPath.replace(/^\//, ""), file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const files: FileEntry[] = [];
  // A reader gives at most a hundred entries at a time, and none at the end.
  for (;;) {
    const some = await new Promise<FileSystemEntry[]>((good, bad) => reader.readEntries(good, bad));
    if (some.length === 0) return files;
    for (const each of some) files.push(...(await filesBelow(each)));
  }
}

/** Keeps the URDF among some files for the vehicle, and the lens for the recording: a closed tab does not lose them. */
export async function keepBeside(vehicleId: string, recordingId: string, files: FileList | undefined): Promise<void> {
  for (const [id, is] of [
    [vehicleId, isUrdf],
    [recordingId, isLens],
  ] as const) {
    const file = [...(files ?? [])].find(is);
    if (file) await keepFile(id, file);
  }
}

/** Keeps one file for a vehicle or a recording. */
export async function keepFile(id: string, file: File): Promise<void> {
  const ages = Object.keys(localStorage)
    .filter((key) => key.startsWith(BESIDE))
    .map((key): [string, number] => [key, (JSON.parse(localStorage.getItem(key) ?? "{}") as { at: number }).at])
    .sort(([, one], [, other]) => one - other);
  for (const [key] of ages.slice(0, 1 - MOST)) localStorage.removeItem(key);
  store(BESIDE + id, { name: file.name, text: await file.text(), at: Date.now() });
}

/** A vehicle's URDF or a recording's lens, where this browser was given it. */
export function fileOf(id: string): File | undefined {
  const kept = JSON.parse(localStorage.getItem(BESIDE + id) ?? "null") as { name: string; text: string } | null;
  return kept ? new File([kept.text], kept.name) : undefined;
}

/** A vehicle's name after a recording's file. */
export const nameAfter = (file: File): string => file.name.replace(/\.[A-Za-z0-9.]{1,10}$/, "") || file.name;
