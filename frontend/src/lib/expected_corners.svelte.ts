/** Where a detection's corners are to be looked for in a camera, and the question about a mark that is far from there. */

import * as annotations from "./api/annotations.ts";
import type { ExpectedCorner } from "./api/schema.ts";
import { cache } from "./cache.svelte.ts";
import type { Pixel } from "./pixels.ts";

export class ExpectedCorners {
  /** Pixels from the expected place, and up to how many are usual. */
  question = $state.raw<{ distance: number; usual: number } | null>(null);
  #corners = $state.raw<Readonly<Record<string, ExpectedCorner>>>({});

  /** Without an answer frames are shown as they come, and nothing is asked. */
  async read(detectionId: string, camera: string): Promise<void> {
    const corners = await cache.query(annotations.expectedCorners(detectionId, camera)).catch(() => []);
    this.#corners = Object.fromEntries(corners.map((corner) => [corner.vertex_id, corner]));
  }

  /** Null where nothing says it. */
  of(vertexId: string | undefined): ExpectedCorner | null {
    return this.#corners[vertexId ?? ""] ?? null;
  }

  /** Whether a mark is so far off that it is asked about. */
  asksAbout(vertexId: string, mark: Pixel): boolean {
    const expected = this.of(vertexId);
    const distance = expected ? Math.hypot(mark.u - expected.u, mark.v - expected.v) : 0;
    this.question = expected && distance > expected.within_px ? { distance, usual: expected.within_px } : null;
    return this.question !== null;
  }
}
