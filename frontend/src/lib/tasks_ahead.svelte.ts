/** What comes next for one person in a camera of a detection: leased and loaded ahead, so that nobody waits for it. */

import * as annotations from "./api/annotations.ts";
import * as people from "./api/people.ts";
import type { Me, TaskView } from "./api/schema.ts";
import { loadFile, preload } from "./images.ts";
import { session } from "./session.svelte.ts";

/** With the first frame come so many: two round trips of a third of a second are over before they are marked. */
const FIRST_AHEAD = 2;
/** So many come behind it, for a person whose network goes; asked for again when half of them are marked. */
const AHEAD = 50;
/** Of these so many are decoded. */
const DECODED = 5;

export class TasksAhead {
  /** Leased, in their order. */
  tasks = $state.raw<readonly TaskView[]>([]);
  /** The vertex that is asked for first, once. */
  first: string | null;
  private questions = 0;
  /** How many came with the last refill. */
  private stock = 0;
  /** By task: the version of the own answer that an answer on its way replaces. */
  private answeredOn: Readonly<Record<string, number>> = {};
  /** How many are leased ahead. */
  private readonly most: number;
  private readonly me: Me;
  private readonly detectionId: string;
  private readonly camera: string;

  /** After `answers` the person leaves the page; 0: nothing says when. */
  constructor(me: Me, detectionId: string, camera: string, first: string | null, answers: number) {
    this.me = me;
    this.detectionId = detectionId;
    this.camera = camera;
    this.first = first;
    this.most = Math.min(AHEAD, answers || AHEAD);
  }

  /** Asks for what comes now; `skip` is given back. Undefined where the browser has become somebody else's. */
  async start(skip: string | null): Promise<TaskView | null | undefined> {
    const open = await this.ask(skip, FIRST_AHEAD);
    if (!open) return undefined;
    const [next, ...ahead] = open;
    this.tasks = ahead;
    return next ?? null;
  }

  /** The next one, if it is here. */
  take(): TaskView | undefined {
    const [next, ...ahead] = this.tasks;
    this.tasks = ahead;
    return next;
  }

  /** What was shown comes again after what is shown in its place. */
  putBack(task: TaskView): void {
    this.tasks = [task, ...this.tasks];
  }

  /** Notes that an answer to a task is on its way, or by null that there is none any more. */
  note(taskId: string, version: number | null): void {
    this.answeredOn = { ...this.answeredOn, [taskId]: version ?? -1 };
  }

  clear(): void {
    this.tasks = [];
  }

  get isLow(): boolean {
    return this.tasks.length <= this.stock / 2;
  }

  /** Leases what comes after the shown task, and renews what is leased. A failure shows when the next one is wanted. */
  async refill(shown: () => TaskView | null): Promise<void> {
    const question = this.questions + 1;
    const open = await this.ask(null, this.most).catch(() => null);
    const task = shown();
    // A later question may have been answered first.
    if (!open || !task || this.questions !== question) return;
    this.tasks = open.filter((one) => one.task_id !== task.task_id && this.isOpen(one));
    this.stock = this.tasks.length;
    this.preload();
  }

  preload(): void {
    for (const task of this.tasks.slice(0, DECODED)) preload(task.frame.url);
    void this.fetchAhead();
  }

  /**
   * One after the other, so that what is asked for meanwhile waits for none of them, until others come ahead. Those that
   * could not come now are asked for with the next answer.
   */
  private async fetchAhead(): Promise<void> {
    const ahead = this.tasks;
    for (const { frame } of ahead) {
      if (ahead !== this.tasks) return;
      await loadFile(frame.url).catch(() => undefined);
    }
  }

  /** The tasks of this person that no answer on its way answers. */
  private async ask(skip: string | null, ahead: number): Promise<readonly TaskView[] | null> {
    this.questions += 1;
    const task = await annotations.nextTask(this.detectionId, this.camera, skip, ahead, this.first);
    this.first = null;
    if (task && task.person_id !== this.me.id) {
      // Another tab has signed in as somebody else: from here on this page is theirs too.
      session.enter(await people.me());
      return null;
    }
    return task ? [task, ...(task.ahead ?? [])].filter((one) => this.isOpen(one)) : [];
  }

  private isOpen(task: TaskView): boolean {
    return task.own.version > (this.answeredOn[task.task_id] ?? -1);
  }
}
