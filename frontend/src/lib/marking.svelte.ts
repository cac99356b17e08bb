/**
 * One person's way through the vertices of a detection in one camera: a task, an answer, the next task. A frame is shown
 * at once, and the answer is saved behind it.
 */

import * as annotations from "./api/annotations.ts";
import { ApiProblem, asProblem } from "./api/http.ts";
import type { VerdictName } from "./api/types.ts";
import type { Me, Progress, TaskView } from "./api/schema.ts";
import { AnswersUnderWay } from "./answers_under_way.ts";
import { cache } from "./cache.svelte.ts";
import { cornerWords } from "./corners.ts";
import { keepDraft, shownMark } from "./drafts.ts";
import { ExpectedCorners } from "./expected_corners.svelte.ts";
import { History } from "./history.svelte.ts";
import { loadImage } from "./images.ts";
import { outbox } from "./outbox.svelte.ts";
import type { Pixel } from "./pixels.ts";
import { Sight } from "./sight.svelte.ts";
import { Strip } from "./strip.svelte.ts";
import { TasksAhead } from "./tasks_ahead.svelte.ts";

const RENEW_MS = 45_000;
const AWAY_MS = 10 * 60_000;

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
  readonly history: History;
  /** The last marks that were given on this page, to compare by eye. */
  readonly strip = new Strip();
  readonly corners = new ExpectedCorners();
  /** Where to look for the shown corner; null where nothing says it. */
  readonly expected = $derived.by(() => this.corners.of(this.task?.vertex.id));

  private readonly me: Me;
  private readonly detectionId: string;
  private readonly camera: string;
  /** What comes next. */
  readonly coming: TasksAhead;
  private readonly underWay: AnswersUnderWay;
  /** Vertices that were skipped since the last answer. */
  private skipped: readonly string[] = [];
  private lastTouch = Date.now();
  private readonly sight = new Sight();

  /** How many answers were given on this page. */
  answered = $state(0);
  /** After `answers` the person leaves the page; 0: nothing says when. */
  constructor(me: Me, detectionId: string, camera: string, first: string | null, answers: number) {
    this.me = me;
    this.detectionId = detectionId;
    this.camera = camera;
    this.coming = new TasksAhead(me, detectionId, camera, first, answers);
    this.underWay = new AnswersUnderWay(me, detectionId, camera);
    this.history = new History(`${me.id}.${detectionId}.${camera}`);
  }

  /** Whether the shown vertex takes an answer now. */
  get idle(): boolean {
    return this.task !== null && !this.busy && !this.waiting && !this.sight.isFresh;
  }

  async start(): Promise<void> {
    await this.guarded(async () => {
      await this.corners.read(this.detectionId, this.camera);
      await outbox.start();
      // Until the service has these, it would hand out the very vertices that they answer.
      this.waiting = this.underWay.areUnsent;
      if (!this.waiting) await this.advance(null);
    });
    void this.count();
  }

  /** Keeps the leases while their person is there, and follows the outbox. Returns the end of it. */
  keep(): () => void {
    const timer = setInterval(() => {
      const away = Date.now() - this.lastTouch > AWAY_MS || document.visibilityState === "hidden";
      if (this.idle && !away) void this.coming.refill(() => this.task);
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
    this.corners.question = null;
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
    if (mark && !sure && this.corners.asksAbout(task.vertex.id, mark)) return;
    await this.guarded(async () => {
      await this.underWay.give(task, verdict, mark);
      this.coming.note(task.task_id, task.own.version);
      this.answered += 1;
      this.skipped = [];
      if (mark && this.image) this.strip.add(task.task_id, this.image, mark);
      const next = this.coming.take();
      if (next) {
        void outbox.send();
        if (this.coming.isLow) void this.coming.refill(() => this.task);
        else this.coming.preload();
        await this.showNext(() => this.show(next));
      } else {
        this.waiting = true;
        await outbox.send();
        await this.goOn();
      }
    });
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
    if (!task || !this.takes(at)) return;
    await this.guarded(async () => {
      await this.advance(task.task_id);
      this.skipped = [...this.skipped, task.vertex.id];
    });
  }

  /**
   * Takes back the last thing done: a mark not yet saved, else a skip, else the last answer. The vertex of these is
   * shown again.
   */
  async undo(at: number): Promise<void> {
    if (this.busy) return;
    // As the frame changed, the answer before it was meant.
    if (!this.waiting && this.mark && this.task && at >= this.sight.from) {
      this.place(null, at);
      return;
    }
    await this.guarded(async () => {
      if (await this.takeUp()) return;
      if (await this.withdraw()) return;
      this.follow();
      await this.takeBack();
    });
    void this.count();
  }

  /** Shows the vertex again that was skipped last. */
  private async takeUp(): Promise<boolean> {
    const vertexId = this.skipped.at(-1);
    if (!vertexId) return false;
    this.skipped = this.skipped.slice(0, -1);
    this.coming.first = vertexId;
    this.waiting = false;
    await this.advance(null);
    return true;
  }

  /** Takes the last answer out of the outbox, unless it has left meanwhile. Its vertex is answered anew. */
  private async withdraw(): Promise<boolean> {
    const withdrawn = await this.underWay.withdraw(this.waiting);
    if (!withdrawn) return false;
    const { answer, task } = withdrawn;
    this.forget(answer.taskId);
    this.waiting = false;
    if (task && answer.mark) keepDraft(this.me.id, task, answer.mark);
    await (task ? this.showAgain(task) : this.advance(null));
    return true;
  }

  private async showAgain(task: TaskView): Promise<void> {
    if (this.task && this.task.task_id !== task.task_id) this.coming.putBack(this.task);
    await this.show(task);
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
    await this.showAgain(task);
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
    else if (at < this.sight.from)
      this.advice = "Your last key or click came as the frame changed. It was not used: do it again.";
    else return true;
    return false;
  }

  private forget(taskId: string): void {
    this.coming.note(taskId, null);
    this.strip.remove(taskId);
  }

  /** Goes on where an answer was waited for that has left. */
  private async settle(): Promise<void> {
    if (this.busy) return;
    this.follow();
    if (this.waiting && this.underWay.all.length === 0) await this.guarded(() => this.goOn());
  }

  /** Notes what became of the answers. */
  private follow(): void {
    const left = this.underWay.left();
    for (const answer of left) {
      if (outbox.wasDropped(answer.order)) this.forget(answer.taskId);
      else this.history.push(answer);
    }
    const last = left.at(-1);
    const progress = last && outbox.progress.get(last.order);
    if (progress) this.progress = progress;
    else if (last) void this.count();
  }

  /** The next task, if there is one that takes an answer. */
  private async goOn(): Promise<void> {
    if (this.underWay.all.length > 0) return;
    this.waiting = false;
    await this.showNext(() => this.advance(null));
  }

  /** Progress costs only the number shown, so nobody waits for it. */
  private async count(): Promise<void> {
    const asked = { ...annotations.progress(this.detectionId, this.camera), staleTime: 0 };
    this.progress = await cache.query(asked).catch(() => this.progress);
  }

  private async advance(skip: string | null): Promise<void> {
    const next = await this.coming.start(skip);
    if (next === undefined) return;
    if (!next && this.underWay.all.length > 0) {
      this.clear();
      this.waiting = true;
      return;
    }
    await this.show(next);
    this.coming.preload();
    if (next) void this.coming.refill(() => this.task);
  }

  private async show(task: TaskView | null): Promise<void> {
    if (!task) {
      this.clear();
      this.finished = true;
      return;
    }
    const image = await loadImage(task.frame.url);
    const mark = shownMark(this.me.id, task);
    this.finished = false;
    this.image = image;
    this.task = task;
    this.mark = mark;
    this.corners.question = null;
    if (mark) this.advice = "Your mark from before is shown again. Enter saves it.";
    void this.sight.begin();
  }

  private clear(): void {
    this.task = this.image = this.mark = null;
    this.coming.clear();
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
