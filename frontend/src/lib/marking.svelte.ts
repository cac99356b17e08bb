/** One person's way through the vertices of a detection in one camera: a task, an answer, the next task. */

import * as annotations from "./api/annotations.ts";
import { vertices } from "./api/detections.ts";
import { ApiProblem, asProblem } from "./api/http.ts";
import { frameUrl } from "./api/recordings.ts";
import type { MarkingProgress, MarkingTask, VerdictName } from "./api/types/annotations.ts";
import type { Vertex } from "./api/types/detections.ts";
import { loadImage, preload } from "./images.ts";
import type { Pixel } from "./pixels.ts";

interface Answered {
  task: MarkingTask;
  verdict: VerdictName;
  mark: Pixel | null;
  /** Distances of others' marks to the own one, shown only after the own answer. */
  others: number[];
}

const AHEAD = 3;
const RENEW_MS = 45_000;
const AWAY_MS = 10 * 60_000;

export class Marking {
  task = $state.raw<MarkingTask | null>(null);
  image = $state.raw<HTMLImageElement | null>(null);
  mark = $state.raw<Pixel | null>(null);
  progress = $state.raw<MarkingProgress | null>(null);
  history = $state.raw<readonly Answered[]>([]);
  problem = $state.raw<ApiProblem | null>(null);
  /** What to do, where a key did not fit: no problem of the service. */
  advice = $state("");
  busy = $state(true);
  finished = $state(false);

  private readonly recordingId: string;
  private readonly detectionId: string;
  private readonly camera: string;
  private order: readonly Vertex[] = [];
  private lastTouch = Date.now();

  constructor(recordingId: string, detectionId: string, camera: string) {
    this.recordingId = recordingId;
    this.detectionId = detectionId;
    this.camera = camera;
  }

  get last(): Answered | undefined {
    return this.history.at(-1);
  }

  async start(): Promise<void> {
    await this.guarded(() => this.advance(null));
    await this.count();
    try {
      this.order = await vertices(this.detectionId, this.camera);
      this.preloadAfter(this.task);
    } catch {
      // Without the order nothing is fetched ahead; marking works all the same.
    }
  }

  /** Keeps the lease of the shown task while its person is there. Returns the end of it. */
  keep(): () => void {
    const timer = setInterval(() => {
      const away = Date.now() - this.lastTouch > AWAY_MS || document.visibilityState === "hidden";
      if (this.task && !this.busy && !away) void annotations.nextTask(this.detectionId, this.camera, null).catch(() => null);
    }, RENEW_MS);
    return () => clearInterval(timer);
  }

  place(mark: Pixel | null): void {
    this.lastTouch = Date.now();
    this.advice = "";
    if (this.task && !this.busy) this.mark = mark;
  }

  async answer(verdict: VerdictName): Promise<void> {
    const task = this.task;
    const mark = verdict === "confirmed" ? this.mark : null;
    if (!task || this.busy) return;
    if (verdict === "confirmed" && !mark) {
      this.advice = "Click the board's top vertex first, or press R where this is no vertex.";
      return;
    }
    await this.guarded(async () => {
      const answer = await annotations.answerTask(task.task_id, verdict, mark);
      this.progress = answer.progress;
      const others = mark ? answer.others.map((other) => Math.hypot(other.u - mark.u, other.v - mark.v)) : [];
      this.history = [...this.history, { task, verdict, mark, others }];
      await this.advance(null);
    });
  }

  async skip(): Promise<void> {
    const task = this.task;
    if (task && !this.busy) await this.guarded(() => this.advance(task.task_id));
  }

  /** Takes back the last thing done: a mark not yet saved, else the last answer, whose vertex is shown again. */
  async undo(): Promise<void> {
    if (this.busy) return;
    if (this.mark && this.task) {
      this.mark = null;
      return;
    }
    const last = this.last;
    if (!last) {
      this.advice = "Nothing was answered on this page yet.";
      return;
    }
    await this.guarded(async () => {
      await annotations.deleteVerdict(last.task.vertex.id);
      if (last.mark) await annotations.deleteMark(this.recordingId, this.camera, last.task.frame.index);
      this.history = this.history.slice(0, -1);
      await this.show(last.task, last.mark);
    });
    await this.count();
    if (!this.problem) this.advice = `Your answer "${last.verdict}" was taken back. Answer this vertex again.`;
  }

  /** Asks again after a problem. */
  async again(): Promise<void> {
    await this.guarded(() => this.advance(null));
  }

  /** Progress is told with every answer; without one, it is asked for. A failure costs only the number shown. */
  private async count(): Promise<void> {
    this.progress = await annotations.progress(this.detectionId, this.camera).catch(() => this.progress);
  }

  private async advance(skip: string | null): Promise<void> {
    const task = await annotations.nextTask(this.detectionId, this.camera, skip);
    await this.show(task, task?.own?.mark ?? null);
    this.preloadAfter(task);
  }

  private async show(task: MarkingTask | null, mark: Pixel | null): Promise<void> {
    this.image = task ? await loadImage(task.frame.url) : null;
    this.task = task;
    this.mark = mark;
    this.finished = task === null;
  }

  /** Vertices are handed out in this order, so the next ones' frames are wanted soon. */
  private preloadAfter(task: MarkingTask | null): void {
    const at = this.order.findIndex((vertex) => vertex.id === task?.vertex.id);
    if (at < 0) return;
    for (const vertex of this.order.slice(at + 1, at + 1 + AHEAD)) {
      const frame = vertex.frames?.[this.camera];
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
    }
  }
}
