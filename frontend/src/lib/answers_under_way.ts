/** Answers of one page of marking that the service is not known to have: in the outbox, each with its task. */

import type { KeptAnswer } from "./answers_kept.ts";
import { randomKey } from "./api/http.ts";
import type { Me, TaskView } from "./api/schema.ts";
import type { VerdictName } from "./api/types.ts";
import { keepDraft } from "./drafts.ts";
import { outbox } from "./outbox.svelte.ts";
import type { Pixel } from "./pixels.ts";

interface Pair {
  answer: KeptAnswer;
  task: TaskView;
}

export class AnswersUnderWay {
  private pairs: readonly Pair[] = [];
  private readonly me: Me;
  private readonly detectionId: string;
  private readonly camera: string;

  constructor(me: Me, detectionId: string, camera: string) {
    this.me = me;
    this.detectionId = detectionId;
    this.camera = camera;
  }

  /** Puts an answer into the outbox; from there on it is no draft any more. */
  async give(task: TaskView, verdict: VerdictName, mark: Pixel | null): Promise<void> {
    const answer = await outbox.add({
      ...{ id: randomKey(), version: task.own.version, verdict, mark },
      ...{ person: this.me.id, personName: this.me.name, detectionId: this.detectionId, camera: this.camera },
      ...{ taskId: task.task_id, vertexId: task.vertex.id, frameIndex: task.frame.index },
    });
    keepDraft(this.me.id, task, null);
    this.pairs = [...this.pairs, { answer, task }];
  }

  /** What the service does not have, refused ones and those from before a reload included. */
  get all(): readonly KeptAnswer[] {
    return [...outbox.unsent, ...outbox.refused].filter((one) => this.isOfPage(one));
  }

  /** Whether some are not sent. */
  get areUnsent(): boolean {
    return outbox.unsent.some((one) => this.isOfPage(one));
  }

  /**
   * Takes the last one out of the outbox, unless it has left meanwhile. Of one from before a reload, which counts where
   * `reloaded`, the task is not known.
   */
  async withdraw(reloaded: boolean): Promise<{ answer: KeptAnswer; task: TaskView | null } | null> {
    const last = this.pairs.at(-1);
    const answer = last?.answer ?? (reloaded ? this.all.at(-1) : undefined);
    if (!answer || !(await outbox.drop(answer.order))) return null;
    this.pairs = this.pairs.filter((pair) => pair.answer.order !== answer.order);
    return { answer, task: last?.task ?? null };
  }

  /** Those that have left the outbox since the last call, in their order. */
  left(): readonly KeptAnswer[] {
    const left = this.pairs.filter((pair) => !outbox.find(pair.answer.order));
    // An answer may be sent again in place of another version.
    this.pairs = this.pairs.flatMap((one) => {
      const answer = outbox.find(one.answer.order);
      return answer ? [{ ...one, answer }] : [];
    });
    return left.map((one) => one.answer);
  }

  private isOfPage(answer: KeptAnswer): boolean {
    return answer.detectionId === this.detectionId && answer.camera === this.camera;
  }
}
