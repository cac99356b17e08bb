/**
 * Marks that were placed and not yet answered, so that a reload, Back or a crash loses none. In `localStorage`, which
 * keeps them before the click's handler ends. Each tab has its own for a vertex: two tabs overwrite nothing.
 */

import { randomKey } from "./api/http.ts";
import type { TaskView } from "./api/schema.ts";
import type { Pixel } from "./pixels.ts";

const PREFIX = "apexcal.draft.";
const MOST = 500;

interface Draft extends Pixel {
  at: number;
}

function tab(): string {
  const known = sessionStorage.getItem("apexcal.tab");
  if (known) return known;
  const made = randomKey();
  sessionStorage.setItem("apexcal.tab", made);
  return made;
}

const ofVertex = (person: string, task: TaskView): string => `${PREFIX}${person}.${task.vertex.id}.${task.camera}.`;

/** Keeps something in the browser, or null: nothing any more. Returns whether the browser could. */
export function store(key: string, value: unknown): boolean {
  try {
    if (value === null) localStorage.removeItem(key);
    else localStorage.setItem(key, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}

/** Keeps the mark of a vertex, or that there is none any more. Returns whether the browser could. */
export function keepDraft(person: string, task: TaskView, mark: Pixel | null): boolean {
  const draft = mark && ({ u: mark.u, v: mark.v, at: Date.now() } satisfies Draft);
  const isKept = store(ofVertex(person, task) + tab(), draft);
  if (isKept) for (const [key] of drafts(PREFIX).slice(0, -MOST)) localStorage.removeItem(key);
  return isKept;
}

/** The mark to show: this tab's draft, else that of the own answer, else the last draft of another tab. */
export function shownMark(person: string, task: TaskView): Pixel | null {
  const prefix = ofVertex(person, task);
  const own = localStorage.getItem(prefix + tab());
  const found = own ? (JSON.parse(own) as Draft) : (task.own.mark ?? drafts(prefix).at(-1)?.[1]);
  return found ? { u: found.u, v: found.v } : null;
}

function drafts(prefix: string): [string, Draft][] {
  return Object.keys(localStorage)
    .filter((key) => key.startsWith(prefix))
    .map((key): [string, Draft] => [key, JSON.parse(localStorage.getItem(key) ?? "{}") as Draft])
    .sort(([, one], [, other]) => one.at - other.at);
}
