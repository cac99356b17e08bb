/**
 * Answers on their way to the service. Each is kept in the browser from the moment when its person gave it, sent in
 * order, tried again until the service says what became of it, and never sent as somebody else. All tabs share it:
 * one sends at a time.
 */

import * as kept from "./answers_kept.ts";
import type { KeptAnswer } from "./answers_kept.ts";
import * as annotations from "./api/annotations.ts";
import { ApiProblem } from "./api/http.ts";
import * as people from "./api/people.ts";
import type { Own, Progress } from "./api/schema.ts";
import { session } from "./session.svelte.ts";

/** So many are kept at most: hours of work without a network. */
const MOST = 500;
const PATIENCE_MS = 10_000;
const FIRST_PAUSE_MS = 1000;
const LONGEST_PAUSE_MS = 30_000;
/** The service did not look at the answer: it may do so later. 401: when the person has signed in again. */
const LATER = new Set([0, 401, 408, 425, 429]);

class Outbox {
  private answers = $state.raw<readonly KeptAnswer[]>([]);
  /** By an answer's order, the progress that came with it where this tab sent it. */
  readonly progress = new Map<number, Progress>();
  /** The last attempt to send failed. */
  late = $state(false);
  private attempts = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private readonly dropped = new Set<number>();
  private readonly listeners = new Set<() => void>();
  private readonly tabs = new BroadcastChannel("apexcal-outbox");

  constructor() {
    this.tabs.addEventListener("message", () => void this.read());
    window.addEventListener("online", () => void this.send());
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState === "visible" && this.unsent.length > 0) void this.send();
    });
  }

  /** The signed-in person's answers that the service has not yet looked at. */
  get unsent(): readonly KeptAnswer[] {
    return this.answers.filter((answer) => answer.person === session.me?.id && !answer.refused);
  }

  /** Those that it did not take. */
  get refused(): readonly KeptAnswer[] {
    return this.answers.filter((answer) => answer.person === session.me?.id && answer.refused);
  }

  get ofOthers(): readonly KeptAnswer[] {
    return this.answers.filter((answer) => answer.person !== session.me?.id);
  }

  find(order: number): KeptAnswer | undefined {
    return this.answers.find((answer) => answer.order === order);
  }

  /** Whether its person took this answer out in this tab. */
  wasDropped(order: number): boolean {
    return this.dropped.has(order);
  }

  /** Calls `listener` whenever an answer comes, goes or is refused. Returns the end of it. */
  onChange(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** Reads what waits in this browser, and sends what is the signed-in person's. */
  async start(): Promise<void> {
    await this.read();
    if (this.unsent.length > 0) await this.send();
  }

  /** Keeps an answer. Throws an `ApiProblem` where this browser cannot. */
  async add(answer: Omit<KeptAnswer, "order" | "refused">): Promise<KeptAnswer> {
    if (this.unsent.length + this.refused.length >= MOST) {
      throw new ApiProblem(0, {
        code: "outbox_full",
        detail: `${MOST} of your answers wait in this browser already; this one was not kept.`,
        hint: "Let them be sent first: check that this computer is online.",
      });
    }
    try {
      const order = await kept.add({ ...answer, refused: null });
      await this.changed();
      return { ...answer, order, refused: null };
    } catch (error) {
      throw new ApiProblem(0, {
        code: "not_kept",
        detail: `This browser cannot keep your answer, so it was not given (${error instanceof Error ? error.message : String(error)}).`,
        hint: "Allow this site to store data, or leave the private window; then press Go on and answer again.",
      });
    }
  }

  private sendLater(): void {
    if (this.timer !== undefined) return;
    const pause = Math.min(LONGEST_PAUSE_MS, FIRST_PAUSE_MS * 2 ** (this.attempts - 1));
    // Browsers that lost the same service do not come back in the same moment.
    this.timer = setTimeout(() => void this.send(), pause * (0.5 + 0.5 * Math.random()));
  }

  /** Sends what waits, in order. Ends when all is sent or refused, or when the service cannot be reached. */
  async send(): Promise<void> {
    const person = session.me?.id;
    if (!person) return;
    clearTimeout(this.timer);
    this.timer = undefined;
    const failed = await this.alone(() => this.sendAll(person));
    await this.read();
    this.late = failed;
    this.attempts = failed ? this.attempts + 1 : 0;
    if (failed) this.sendLater();
  }

  /**
   * Takes an answer out: its person took it back before it was sent, or gives up what was refused. Returns whether it
   * was still here.
   */
  async drop(order: number): Promise<boolean> {
    const here = await this.alone(async () => {
      const found = (await kept.all()).some((one) => one.order === order);
      if (found) await kept.remove(order);
      return found;
    });
    if (here) this.dropped.add(order);
    await this.changed();
    return here;
  }

  /** Sends a refused answer again; with `version` in place of the answer of that version. */
  async retry(answer: KeptAnswer, version = answer.version): Promise<void> {
    await this.alone(() => kept.replace({ ...answer, version, refused: null }));
    await this.changed();
    await this.send();
  }

  private async sendAll(person: string): Promise<boolean> {
    for (const answer of await kept.all()) {
      if (answer.person !== person || answer.refused) continue;
      const problem = await this.deliver(answer);
      if (problem === "later") return true;
      if (problem === null) await kept.remove(answer.order);
      else await kept.replace({ ...answer, refused: problem.document });
      this.tabs.postMessage("changed");
    }
    return false;
  }

  /** Sends one answer: null where the service has it, its refusal, or "later" where nothing is known of it. */
  private async deliver(answer: KeptAnswer): Promise<ApiProblem | "later" | null> {
    const { id, version, verdict, mark } = answer;
    try {
      const sent = { id, version, verdict, mark: mark && { u: mark.u, v: mark.v } };
      const { progress } = await annotations.answerTask(answer.taskId, sent, AbortSignal.timeout(PATIENCE_MS));
      if (progress) this.progress.set(answer.order, progress);
      return null;
    } catch (error) {
      if (!(error instanceof ApiProblem) || LATER.has(error.status) || error.status >= 500) return "later";
      // Another tab may have signed in as somebody else, for whom this task does not exist.
      if (error.status === 404 && !(await this.isStill(answer.person))) return "later";
      return error;
    }
  }

  private async isStill(person: string): Promise<boolean> {
    try {
      const me = await people.me();
      if (me.id !== person) session.enter(me);
      return me.id === person;
    } catch {
      return false;
    }
  }

  /** One tab at a time. Without locks (plain HTTP to another host) ids and versions keep two from doing harm. */
  private alone<T>(work: () => Promise<T>): Promise<T> {
    return "locks" in navigator ? navigator.locks.request("apexcal-outbox", work) : work();
  }

  private async changed(): Promise<void> {
    await this.read();
    this.tabs.postMessage("changed");
  }

  private async read(): Promise<void> {
    this.answers = await kept.all().catch(() => this.answers);
    for (const listener of this.listeners) listener();
  }
}

export const outbox = new Outbox();

/** The person's own answer that stands in the way of a refused one, where that is the reason. */
export function standing(answer: KeptAnswer): Own | null {
  return answer.refused?.code === "answer_changed" ? (answer.refused.own as Own) : null;
}
