/**
 * One person's way through the vertices of a detection in one camera: a task, an answer, the next task. The next ones
 * are leased and their frames loaded ahead, so that a frame is shown at once and the answer is saved behind it.
 */

import * as annotations from "./api/annotations.ts";
import { ApiProblem, asProblem, randomKey } from "./api/http.ts";
import * as people from "./api/people.ts";
import type { VerdictName } from "./api/types.ts";
import type { ExpectedCorner, Me, Progress, TaskView } from "./api/schema.ts";
import { cache } from "./cache.svelte.ts";
import { cornerWords } from "./corners.ts";
import { keepDraft, shownMark } from "./drafts.ts";
import type { KeptAnswer } from "./answers_kept.ts";
import { History } from "./history.svelte.ts";
import { loadFile, loadImage, preload } from "./images.ts";
import { outbox } from "./outbox.svelte.ts";
import { painted } from "./painted.ts";
import type { Pixel } from "./pixels.ts";
import { session } from "./session.svelte.ts";
import { Strip } from "./strip.svelte.ts";

/** With the first frame come so many: two round trips of a third of a second are over before they are marked. */
const FIRST_AHEAD = 2;
/** So many come behind it, for a person whose network goes; asked for again when half of them are marked. */
const AHEAD = 50;
/** Of these so many are decoded. */
const DECODED = 5;
const RENEW_MS = 45_000;
const AWAY_MS = 10 * 60_000;
/** Nobody reacts to a new picture faster (simple visual reaction time): an earlier click meant the one before. */
const REACTION_MS = 200;

/** An answer that was given here and is not known to have arrived, with the task that it answers. */
interface Given {
  answer: KeptAnswer;
  task: TaskView;
}

export class Marking {
  task = $state.raw<TaskView | null>(null);
  image = $state.raw<HTMLImageElement | null>(null);
  mark = $state.raw<Pixel | null>(null);
  progress = $state.raw<Progress | null>(null);
  problem = $state.raw<ApiProblem | null>(null);
  /** Which corner of the board `top` is: see `upperCorner`. */
  upper = $state(0);
  /** What to do, where a key or a click was not used: no problem of the service. */
  advice = $state("");
  busy = $state(true);
  finished = $state(false);
  /** The shown vertex is answered, or none is shown, and there is no next one before an answer has arrived. */
  waiting = $state(false);
  /** The frame is so new that nobody can have meant it yet. */
  private fresh = $state(false);
  readonly history: History;
  /** The last marks that were given on this page, to compare by eye. */
  readonly strip = new Strip();
  /** Where to look for the shown corner; null where nothing says it. */
  readonly expected = $derived.by(() => this.#expected[this.task?.vertex.id ?? ""] ?? null);
  /** Asked about a mark that is far from there: pixels between them, and up to how many are usual. */
  question = $state.raw<{ distance: number; usual: number } | null>(null);
  #expected = $state.raw<Readonly<Record<string, ExpectedCorner>>>({});

  private readonly me: Me;
  private readonly detectionId: string;
  private readonly camera: string;
  private asked = 0;
  /** How many came with the last refill. */
  private stock = 0;
  /** What comes next, leased. */
  ahead = $state.raw<readonly TaskView[]>([]);
  private given: readonly Given[] = [];
  /** By task: the version of the own answer that an answer given here replaces. */
  private answeredOn: Readonly<Record<string, number>> = {};
  private lastTouch = Date.now();
  /** From when on, in time stamps of events, the shown frame was seen. */
  private seenFrom = Infinity;

  /** How many answers were given on this page. */
  answered = $state(0);
  /** The vertex that is shown first. */
  private first: string | null;
  /** How many are leased ahead. */
  private readonly most: number;

  /** After `answers` the person leaves the page; 0: nothing says when. */
  constructor(me: Me, detectionId: string, camera: string, first: string | null, answers: number) {
    this.me = me;
    this.first = first;
    this.most = Math.min(AHEAD, answers || AHEAD);
    this.detectionId = detectionId;
    this.camera = camera;
    this.history = new History(`${me.id}.${detectionId}.${camera}`);
  }

  /** Whether the shown vertex takes an answer now. */
  get idle(): boolean {
    return this.task !== null && !this.busy && !this.waiting && !this.fresh;
  }

  async start(): Promise<void> {
    await this.guarded(async () => {
      await this.look();
      await outbox.start();
      // Until the service has these, it would hand out the very vertices that they answer.
      this.waiting = outbox.unsent.some((one) => this.isOfThisPage(one));
      if (!this.waiting) await this.advance(null);
    });
    void this.count();
  }

  /** Reads where the corners are expected. Without it frames are shown as they come, and nothing is asked. */
  private async look(): Promise<void> {
    const corners = await cache.query(annotations.expectedCorners(this.detectionId, this.camera)).catch(() => []);
    this.#expected = Object.fromEntries(corners.map((one) => [one.vertex_id, one]));
  }

  /** Keeps the leases while their person is there, and follows the outbox. Returns the end of it. */
  keep(): () => void {
    const timer = setInterval(() => {
      const away = Date.now() - this.lastTouch > AWAY_MS || document.visibilityState === "hidden";
      if (this.idle && !away) void this.refill();
    }, RENEW_MS);
    const deaf = outbox.onChange(() => void this.settle());
    return () => {
      clearInterval(timer);
      deaf();
    };
  }

  /** Places or removes the mark. `at`: when the click or key began, as its event says. */
  place(mark: Pixel | null, at: number): void {
    this.lastTouch = Date.now();
    const task = this.task;
    if (!task || !this.takes(at)) return;
    this.mark = mark;
    this.question = null;
    const isKept = keepDraft(this.me.id, task, mark);
    this.advice = isKept ? "" : "This browser cannot keep the mark: save it before you leave the page.";
  }

  /** Answers the shown vertex. `sure`: the mark is kept wherever it is; a hand that saves every mark does not say so. */
  async answer(verdict: VerdictName, at: number, sure = false): Promise<void> {
    const task = this.task;
    if (!task || !this.takes(at)) return;
    const mark = verdict === "confirmed" ? this.mark : null;
    if (verdict === "confirmed" && !mark) {
      this.advice = `Click the board's ${cornerWords(task.vertex.corner, this.upper)} first, or press R where it is no such corner.`;
      return;
    }
    if (mark && !sure && this.asksAbout(mark)) return;
    const { task_id: taskId, vertex, frame, own } = task;
    await this.guarded(async () => {
      const answer = await outbox.add({
        ...{ id: randomKey(), version: own.version, verdict, mark },
        ...{ person: this.me.id, personName: this.me.name, detectionId: this.detectionId, camera: this.camera },
        ...{ taskId, vertexId: vertex.id, frameIndex: frame.index },
      });
      // From here on it is no draft any more: the outbox has it.
      keepDraft(this.me.id, task, null);
      this.given = [...this.given, { answer, task }];
      this.answeredOn = { ...this.answeredOn, [taskId]: own.version };
      this.answered += 1;
      if (mark && this.image) this.strip.add(taskId, this.image, mark);
      const [next, ...ahead] = this.ahead;
      this.ahead = ahead;
      if (next) {
        void outbox.send();
        if (ahead.length <= this.stock / 2) void this.refill();
        else this.preload();
        await this.showNext(() => this.show(next));
      } else {
        this.waiting = true;
        await outbox.send();
        await this.goOn();
      }
    });
  }

  private asksAbout(mark: Pixel): boolean {
    if (!this.expected) return false;
    const { u, v, within_px: usual } = this.expected;
    const distance = Math.hypot(mark.u - u, mark.v - v);
    this.question = distance > usual ? { distance, usual } : null;
    return this.question !== null;
  }

  /** Where the next frame fails to come, the answered vertex is shown no longer: it must not take another answer. */
  private async showNext(come: () => Promise<void>): Promise<void> {
    try {
      await come();
    } catch (error) {
      this.clear();
      throw error;
    }
  }

  async skip(at: number): Promise<void> {
    const task = this.task;
    if (task && this.takes(at)) await this.guarded(() => this.advance(task.task_id));
  }

  /**
   * Takes back the last thing done: an answer not yet sent, else a mark not yet saved, else the last answer, whose
   * vertex is shown again.
   */
  async undo(at: number): Promise<void> {
    if (this.busy) return;
    // As the frame changed, the answer before it was meant.
    if (!this.waiting && this.mark && this.task && at >= this.seenFrom) {
      this.place(null, at);
      return;
    }
    await this.guarded(async () => {
      if (await this.withdraw()) return;
      this.follow();
      await this.takeBack();
    });
    void this.count();
  }

  /** Takes the last answer out of the outbox, unless it has left meanwhile. Its vertex is answered anew. */
  private async withdraw(): Promise<boolean> {
    const last = this.given.at(-1);
    // After a reload the task of an answer that waits is not known: it is asked for.
    const answer = last?.answer ?? (this.waiting ? this.ofThisPage().at(-1) : undefined);
    if (!answer || !(await outbox.drop(answer.order))) return false;
    this.forget(answer.taskId);
    this.given = this.given.filter((one) => one.answer.order !== answer.order);
    this.waiting = false;
    if (!last) {
      await this.advance(null);
      return true;
    }
    const { task } = last;
    if (answer.mark) keepDraft(this.me.id, task, answer.mark);
    if (this.task && this.task.task_id !== task.task_id) this.ahead = [this.task, ...this.ahead];
    await this.show(task);
    return true;
  }

  /** Takes back the last answer that the service has, and shows its vertex again. */
  private async takeBack(): Promise<void> {
    const last = this.history.last;
    if (!last) {
      this.advice = "Nothing was answered on this page yet.";
      return;
    }
    const task = await annotations.undoAnswer(last.taskId, last.undoId, last.version).catch((error: unknown) => {
      // It was changed elsewhere, or is gone: the next undo is of the answer before it.
      if (error instanceof ApiProblem && [404, 409].includes(error.status)) this.history.pop();
      throw error;
    });
    this.history.pop();
    this.forget(last.taskId);
    if (this.task && this.task.task_id !== task.task_id) this.ahead = [this.task, ...this.ahead];
    await this.show(task);
    this.advice = `Your answer "${last.verdict}" was taken back. Answer this corner again.`;
  }

  /** Goes on after a problem: with the vertex that is shown, else with the next one. */
  async again(): Promise<void> {
    await this.guarded(async () => {
      if (!this.task && !this.waiting) await this.advance(null);
    });
  }

  /** Whether what the person did at this moment was meant for the vertex that is shown. Says so where it was not. */
  private takes(at: number): boolean {
    if (this.waiting) this.advice = "Your answers wait here until the service has them. Z takes the last one back.";
    else if (this.busy) this.advice = "Your last key or click came while your answer was on its way. It was not used.";
    else if (at < this.seenFrom)
      this.advice = "Your last key or click came as the frame changed. It was not used: do it again.";
    else return true;
    return false;
  }

  /** What the service does not have of this page's answers, refused ones included. */
  private ofThisPage(): readonly KeptAnswer[] {
    return [...outbox.unsent, ...outbox.refused].filter((one) => this.isOfThisPage(one));
  }

  private isOfThisPage(answer: KeptAnswer): boolean {
    return answer.detectionId === this.detectionId && answer.camera === this.camera;
  }

  private forget(taskId: string): void {
    this.answeredOn = { ...this.answeredOn, [taskId]: -1 };
    this.strip.remove(taskId);
  }

  /** Goes on where an answer was waited for that has left. */
  private async settle(): Promise<void> {
    if (this.busy) return;
    this.follow();
    if (this.waiting && this.ofThisPage().length === 0) await this.guarded(() => this.goOn());
  }

  /** Notes what became of the answers. */
  private follow(): void {
    const left = this.given.filter((one) => !outbox.find(one.answer.order));
    // An answer may be sent again in place of another version.
    this.given = this.given.flatMap((one) => {
      const answer = outbox.find(one.answer.order);
      return answer ? [{ ...one, answer }] : [];
    });
    for (const { answer } of left) {
      if (outbox.wasDropped(answer.order)) this.forget(answer.taskId);
      else this.history.push(answer);
    }
    const last = left.at(-1);
    const progress = last && outbox.progress.get(last.answer.order);
    if (progress) this.progress = progress;
    else if (last) void this.count();
  }

  /** The next task, if there is one that takes an answer. */
  private async goOn(): Promise<void> {
    if (this.ofThisPage().length > 0) return;
    this.waiting = false;
    await this.showNext(() => this.advance(null));
  }

  /** Progress costs only the number shown, so nobody waits for it. */
  private async count(): Promise<void> {
    const asked = { ...annotations.progress(this.detectionId, this.camera), staleTime: 0 };
    this.progress = await cache.query(asked).catch(() => this.progress);
  }

  private async advance(skip: string | null): Promise<void> {
    const tasks = await this.ask(skip, FIRST_AHEAD);
    if (!tasks) return;
    const [next, ...ahead] = tasks;
    this.ahead = ahead;
    if (!next && this.ofThisPage().length > 0) {
      this.clear();
      this.waiting = true;
      return;
    }
    await this.show(next ?? null);
    this.preload();
    if (next) void this.refill();
  }

  /** Leases what comes after the shown task, and renews what is leased. A failure shows when the next task is wanted. */
  private async refill(): Promise<void> {
    const asked = this.asked + 1;
    const tasks = await this.ask(null, this.most).catch(() => null);
    // A later question may have been answered first.
    if (!tasks || !this.task || this.asked !== asked) return;
    const shown = this.task.task_id;
    this.ahead = tasks.filter((one) => one.task_id !== shown && this.isOpen(one));
    this.stock = this.ahead.length;
    this.preload();
  }

  /** The tasks of this person that no answer on its way answers. Null where the browser has become somebody else's. */
  private async ask(skip: string | null, ahead: number): Promise<readonly TaskView[] | null> {
    this.asked += 1;
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

  private async show(task: TaskView | null): Promise<void> {
    if (!task) {
      this.clear();
      this.finished = true;
      return;
    }
    const image = await loadImage(task.frame.url);
    const mark = shownMark(this.me.id, task);
    this.seenFrom = Infinity;
    this.fresh = true;
    this.finished = false;
    this.image = image;
    this.task = task;
    this.mark = mark;
    this.question = null;
    if (mark) this.advice = "Your mark from before is shown again. Enter saves it.";
    void this.watch(task);
  }

  /** Waits until the frame is on the screen and could have been seen. */
  private async watch(task: TaskView): Promise<void> {
    await painted();
    if (this.task !== task) return;
    this.seenFrom = performance.now() + REACTION_MS;
    setTimeout(() => {
      if (this.task === task) this.fresh = false;
    }, REACTION_MS);
  }

  private clear(): void {
    this.task = this.image = this.mark = null;
    this.ahead = [];
  }

  private preload(): void {
    for (const task of this.ahead.slice(0, DECODED)) preload(task.frame.url);
    void this.fetchAhead();
  }

  /**
   * One after the other, so that what is asked for meanwhile waits for none of them, until others come ahead. Those that
   * could not come now are asked for with the next answer.
   */
  private async fetchAhead(): Promise<void> {
    const ahead = this.ahead;
    for (const { frame } of ahead) {
      if (ahead !== this.ahead) return;
      await loadFile(frame.url).catch(() => undefined);
    }
  }

  private async guarded(work: () => Promise<void>): Promise<void> {
    this.busy = true;
    this.problem = null;
    this.advice = "";
    this.lastTouch = Date.now();
    try {
      await work();
    } catch (error) {
      this.problem = asProblem(error);
    } finally {
      this.busy = false;
      // What came while this was busy.
      void this.settle();
    }
  }
}
