/** One person's way through the pages of crops of a detection in one camera: a page, what is wrong on it, the next. */

import { Action } from "./action.svelte.ts";
import * as crops from "./api/crops.ts";
import { ApiProblem, randomKey } from "./api/http.ts";
import type { CropProgress, CropSheet, CropVerdict } from "./api/schema.ts";
import { cache } from "./cache.svelte.ts";
import { store } from "./drafts.ts";
import { outbox } from "./outbox.svelte.ts";

/** What a page's answer will be. It is kept in the browser, so that a reload or an answer sent twice changes nothing. */
interface Draft {
  id: string;
  wrong: string[];
}

export class Crops extends Action {
  page = $state.raw<CropSheet | null>(null);
  progress = $state.raw<CropProgress | null>(null);
  /** What became of the page before. */
  verdict = $state.raw<CropVerdict | null>(null);
  wrong = $state.raw<readonly string[]>([]);
  finished = $state(false);
  /** The service may or may not have the answer: it is sent again as it is. */
  unsent = $state(false);
  private id = "";

  private readonly detectionId: string;
  private readonly camera: string;

  constructor(detectionId: string, camera: string) {
    super();
    this.detectionId = detectionId;
    this.camera = camera;
  }

  start(): Promise<void> {
    return this.guarded(() => this.next());
  }

  /** Says that a mark is wrong, or takes that back. */
  toggle(vertexId: string): void {
    if (!this.page || this.busy || this.unsent) return;
    const others = this.wrong.filter((id) => id !== vertexId);
    this.wrong = others.length < this.wrong.length ? others : [...others, vertexId];
    this.keep(this.page);
  }

  /** Accepts every mark of the page but the wrong ones. */
  accept(): Promise<void> {
    return this.guarded(async () => {
      const page = this.page;
      if (!page) return;
      try {
        this.verdict = await crops.answerPage(page.id, { id: this.id, wrong: [...this.wrong] });
        this.progress = this.verdict.progress;
      } catch (error) {
        this.unsent = !(error instanceof ApiProblem) || error.status === 0 || error.status >= 500;
        // It was answered elsewhere: what this tab shows is no longer asked.
        if (!(error instanceof ApiProblem) || error.status !== 409) throw error;
        this.verdict = null;
        this.forget(page);
        await this.next();
        throw error;
      }
      this.forget(page);
      await this.next();
    });
  }

  private async next(): Promise<void> {
    this.page = null;
    // Marks that wait in this browser count, too.
    await outbox.start();
    const asked = { ...crops.progress(this.detectionId, this.camera), staleTime: 0 };
    this.progress = await cache.query(asked);
    if ((this.progress?.blind_needed ?? 0) > 0) return;
    const page = await crops.nextPage(this.detectionId, this.camera);
    this.finished = page === null;
    this.page = page;
    if (!page) return;
    const draft = this.draft(page);
    this.id = draft.id;
    this.wrong = draft.wrong;
    this.keep(page);
  }

  private guarded(work: () => Promise<void>): Promise<void> {
    this.unsent = false;
    return this.run(work);
  }

  private draft(page: CropSheet): Draft {
    const text = localStorage.getItem(keyOf(page));
    return text ? (JSON.parse(text) as Draft) : { id: randomKey(), wrong: [] };
  }

  /** Without storage the page still works; a reload forgets what was flagged. */
  private keep(page: CropSheet): void {
    store(keyOf(page), { id: this.id, wrong: [...this.wrong] } satisfies Draft);
  }

  private forget(page: CropSheet): void {
    localStorage.removeItem(keyOf(page));
    this.wrong = [];
  }
}

const keyOf = (page: CropSheet): string => `apexcal.crops.${page.person_id}.${page.id}`;
