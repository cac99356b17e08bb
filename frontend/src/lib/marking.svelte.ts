/** One person's way through the vertices of a detection in one camera: a task, an answer, the next task. */

import * as annotations from "./api/annotations.ts";
import { vertices } from "./api/detections.ts";
import { ApiProblem, asProblem, randomKey } from "./api/http.ts";
import * as people from "./api/people.ts";
import { frameUrl } from "./api/recordings.ts";
import type { MarkingProgress, MarkingTask, Me, VerdictName, Vertex } from "./api/types.ts";
import { cache } from "./cache.svelte.ts";
import { keepDraft, shownMark } from "./drafts.ts";
import type { KeptAnswer } from "./answers_kept.ts";
import { History } from "./history.svelte.ts";
import { loadImage, preload } from "./images.ts";
import { outbox } from "./outbox.svelte.ts";
import type { Pixel } from "./pixels.ts";
import { session } from "./session.svelte.ts";

const AHEAD = 3;
const RENEW_MS = 45_000;
const AWAY_MS = 10 * 60_000;
/** Nobody reacts to a new picture faster (simple visual reaction time): an earlier click meant the one before. */
const REACTION_MS = 200;

export class Marking {
  task = $state.raw<MarkingTask | null>(null);
  image = $state.raw<HTMLImageElement | null>(null);
  mark = $state.raw<Pixel | null>(null);
  progress = $state.raw<MarkingProgress | null>(null);
  problem = $state.raw<ApiProblem | null>(null);
  /** What to do, where a key or a click was not used: no problem of the service. */
  advice = $state("");
  busy = $state(true);
  finished = $state(false);
  /** The answer that must be sent, or decided on, before there is a next task. */
  private waitsFor = $state.raw<KeptAnswer | null>(null);
  /** The frame is so new that nobody can have meant it yet. */
  private fresh = $state(false);
  readonly history: History;

  private readonly me: Me;
  private readonly recordingId: string;
  private readonly detectionId: string;
  private readonly camera: string;
  private order: readonly Vertex[] = [];
  private lastTouch = Date.now();
  /** From when on, in time stamps of events, the shown frame was seen. */
  private seenFrom = Infinity;

  constructor(me: Me, recordingId: string, detectionId: string, camera: string) {
    this.me = me;
    this.recordingId = recordingId;
    this.detectionId = detectionId;
    this.camera = camera;
    this.history = new History(`${me.id}.${detectionId}.${camera}`);
  }

  /** An answer of this page is kept in the browser and not yet sent. */
  get waiting(): boolean {
    return this.waitsFor !== null;
  }

  /** Whether the shown vertex takes an answer now. */
  get idle(): boolean {
    return this.task !== null && !this.busy && !this.waiting && !this.fresh;
  }

  async start(): Promise<void> {
    await this.guarded(async () => {
      await outbox.start();
      // Until the service has these, it would hand out the very vertices that they answer.
      const here = outbox.unsent.filter((one) => one.detectionId === this.detectionId && one.camera === this.camera);
      this.waitsFor = here.at(-1) ?? null;
      if (!this.waiting) await this.advance(null);
    });
    void this.count();
    try {
      this.order = await cache.query(vertices(this.detectionId, this.camera));
      this.preloadAfter(this.task);
    } catch {
      // Without the order nothing is fetched ahead; marking works all the same.
    }
  }

  /** Keeps the lease of the shown task while its person is there, and follows the outbox. Returns the end of it. */
  keep(): () => void {
    const timer = setInterval(() => {
      const away = Date.now() - this.lastTouch > AWAY_MS || document.visibilityState === "hidden";
      if (this.idle && !away) void annotations.nextTask(this.detectionId, this.camera, null).catch(() => null);
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
    const isKept = keepDraft(this.me.id, task, mark);
    this.advice = isKept ? "" : "This browser cannot keep the mark: save it before you leave the page.";
  }

  async answer(verdict: VerdictName, at: number): Promise<void> {
    const task = this.task;
    if (!task || !this.takes(at)) return;
    const mark = verdict === "confirmed" ? this.mark : null;
    if (verdict === "confirmed" && !mark) {
      this.advice = "Click the board's top vertex first, or press R where this is no vertex.";
      return;
    }
    const { task_id: taskId, vertex, frame, own } = task;
    await this.guarded(async () => {
      this.waitsFor = await outbox.add({
        ...{ id: randomKey(), version: own.version, verdict, mark },
        ...{ person: this.me.id, personName: this.me.name, detectionId: this.detectionId, camera: this.camera },
        ...{ taskId, vertexId: vertex.id, frameIndex: frame.index },
      });
      // From here on it is no draft any more: the outbox has it.
      keepDraft(this.me.id, task, null);
      await outbox.send();
      await this.goOn();
    });
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
    if (this.waiting) return this.withdraw();
    if (this.task && !this.takes(at)) return;
    if (this.mark && this.task) {
      this.place(null, at);
      return;
    }
    const last = this.history.last;
    if (!last) {
      this.advice = "Nothing was answered on this page yet.";
      return;
    }
    await this.guarded(async () => {
      const task = await annotations.undoAnswer(last.taskId, last.undoId, last.version).catch((error: unknown) => {
        // It was changed elsewhere, or is gone: the next undo is of the answer before it.
        if (error instanceof ApiProblem && [404, 409].includes(error.status)) this.history.pop();
        throw error;
      });
      this.history.pop();
      await this.show(task);
      this.advice = `Your answer "${last.verdict}" was taken back. Answer this vertex again.`;
    });
    void this.count();
  }

  /** Goes on after a problem: with the vertex that is shown, else with the next one. */
  async again(): Promise<void> {
    await this.guarded(async () => {
      if (!this.task && !this.waiting) await this.advance(null);
    });
  }

  /** Whether what the person did at this moment was meant for the vertex that is shown. Says so where it was not. */
  private takes(at: number): boolean {
    if (this.waiting) this.advice = "The service does not have your answer to this vertex yet. Z takes it back.";
    else if (this.busy) this.advice = "Your last key or click came while your answer was on its way. It was not used.";
    else if (at < this.seenFrom)
      this.advice = "Your last key or click came as the frame changed. It was not used: do it again.";
    else return true;
    return false;
  }

  /** Takes the answer that waits out of the outbox, unless it has left meanwhile. Its vertex is answered anew. */
  private async withdraw(): Promise<void> {
    const waiting = this.waitsFor;
    if (!waiting || this.busy) return;
    await this.guarded(async () => {
      if (!(await outbox.drop(waiting.order))) return;
      this.waitsFor = null;
      if (this.task) keepDraft(this.me.id, this.task, this.mark);
      else await this.advance(null);
    });
  }

  /** Goes on as soon as the answer that was waited for is sent, or given up. */
  private async settle(): Promise<void> {
    if (!this.waitsFor || this.busy) return;
    // It may be sent again in place of another version.
    const kept = outbox.find(this.waitsFor.order);
    if (kept) this.waitsFor = kept;
    else await this.guarded(() => this.goOn());
  }

  /** The next task, if the answer of the shown one has left the outbox. */
  private async goOn(): Promise<void> {
    const sent = this.waitsFor;
    if (!sent || outbox.find(sent.order)) return;
    this.waitsFor = null;
    if (!outbox.wasDropped(sent.order)) this.history.push(sent);
    try {
      await this.advance(null);
    } catch (error) {
      // The vertex is answered: it must not take another answer.
      this.clear();
      throw error;
    } finally {
      void this.count();
    }
  }

  /** Progress costs only the number shown, so nobody waits for it. */
  private async count(): Promise<void> {
    const asked = { ...annotations.progress(this.detectionId, this.camera), staleTime: 0 };
    this.progress = await cache.query(asked).catch(() => this.progress);
  }

  private async advance(skip: string | null): Promise<void> {
    const task = await annotations.nextTask(this.detectionId, this.camera, skip);
    if (task && task.person_id !== this.me.id) {
      // Another tab has signed in as somebody else: from here on this page is theirs too.
      session.enter(await people.me());
      return;
    }
    await this.show(task);
    this.preloadAfter(task);
  }

  private async show(task: MarkingTask | null): Promise<void> {
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
    if (mark) this.advice = "Your mark from before is shown again. Enter saves it.";
    void this.watch(task);
  }

  /** Waits until the frame is on the screen and could have been seen. */
  private async watch(task: MarkingTask): Promise<void> {
    await painted();
    if (this.task !== task) return;
    this.seenFrom = performance.now() + REACTION_MS;
    setTimeout(() => {
      if (this.task === task) this.fresh = false;
    }, REACTION_MS);
  }

  private clear(): void {
    this.task = this.image = this.mark = null;
  }

  /** Vertices are handed out in this order, so the next ones' frames are wanted soon. */
  private preloadAfter(task: MarkingTask | null): void {
    const at = this.order.findIndex((vertex) => vertex.id === task?.vertex.id);
    if (at < 0) return;
    for (const vertex of this.order.slice(at + 1, at + 1 + AHEAD)) {
      const frame = vertex.frames[this.camera];
      if (frame) preload(frameUrl(this.recordingId, this.camera, frame.index));
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

/** The next frame that the browser has drawn. */
function painted(): Promise<void> {
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())));
}
