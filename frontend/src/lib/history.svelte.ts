/** What was answered in this tab, so that it can be taken back; also after a reload. */

import { randomKey } from "./api/http.ts";
import type { VerdictName } from "./api/types.ts";
import type { KeptAnswer } from "./answers_kept.ts";
import type { Pixel } from "./pixels.ts";

export interface Answered {
  taskId: string;
  verdict: VerdictName;
  mark: Pixel | null;
  /** The version that the service gave it. */
  version: number;
  /** The id under which it is taken back, once. */
  undoId: string;
}

const MOST = 50;

export class History {
  private answers = $state.raw<readonly Answered[]>([]);
  private readonly key: string;

  constructor(name: string) {
    this.key = `apexcal.answered.${name}`;
    this.answers = JSON.parse(sessionStorage.getItem(this.key) ?? "[]") as Answered[];
  }

  get last(): Answered | undefined {
    return this.answers.at(-1);
  }

  /** Remembers an answer that the service has. */
  push({ taskId, verdict, mark, version }: KeptAnswer): void {
    this.keep([...this.answers, { taskId, verdict, mark, version: version + 1, undoId: randomKey() }].slice(-MOST));
  }

  pop(): void {
    this.keep(this.answers.slice(0, -1));
  }

  private keep(answers: readonly Answered[]): void {
    this.answers = answers;
    sessionStorage.setItem(this.key, JSON.stringify(answers));
  }
}
