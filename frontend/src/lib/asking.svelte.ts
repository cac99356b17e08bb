/** An answer that keeps up with a form: asked for when the typing rests, and one question at a time. */

import { asProblem, type ApiProblem } from "./api/http.ts";

const REST_MS = 400;

export class Asking<Question, Answer> {
  answer = $state.raw<Answer | undefined>(undefined);
  problem = $state.raw<ApiProblem | null>(null);
  private answered = $state.raw("");
  private busy = false;
  private readonly question: () => Question;
  private readonly ask: (question: Question) => Promise<Answer>;
  private readonly wanted: string;

  /** Create it while a component is initialised. `question` is followed, and is what JSON can hold. */
  constructor(question: () => Question, ask: (question: Question) => Promise<Answer>) {
    this.question = question;
    this.ask = ask;
    this.wanted = $derived(JSON.stringify(this.question()));
    $effect(() => {
      void this.wanted;
      const timer = setTimeout(() => void this.catchUp(), REST_MS);
      return () => clearTimeout(timer);
    });
  }

  /** Whether answer and problem are of what the form holds now. */
  get settled(): boolean {
    return this.answered === this.wanted;
  }

  /** Asks once more, though nothing changed. */
  readonly retry = (): void => {
    this.answered = "";
    void this.catchUp();
  };

  private async catchUp(): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    try {
      while (!this.settled) {
        const of = this.wanted;
        try {
          const answer = await this.ask(JSON.parse(of) as Question);
          this.answer = answer;
          this.problem = null;
        } catch (error) {
          this.answer = undefined;
          this.problem = asProblem(error);
        }
        this.answered = of;
      }
    } finally {
      this.busy = false;
    }
  }
}
