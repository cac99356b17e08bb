/** Asks about a mark that is far from the place that the person's other marks predict. */

import * as annotations from "../api/annotations.ts";
import * as detections from "../api/detections.ts";
import * as fleets from "../api/fleets.ts";
import * as recordings from "../api/recordings.ts";
import type { TaskView } from "../api/schema.ts";
import { cache } from "../cache.svelte.ts";
import { mountOf, type Mount } from "../overlay/projection.ts";
import type { Pixel } from "../pixels.ts";
import { expectationOf, type Doubt, type Expectation, type OwnPair } from "./expectation.ts";

interface Marked extends OwnPair {
  vertexId: string;
}

export class Doubts {
  /** What is asked about the mark of the shown vertex. */
  question = $state.raw<Doubt | null>(null);
  private pairs: readonly Marked[] = [];
  private nominal: Mount | null = null;
  private expected: Expectation | null = null;
  private stale = true;

  /** Reads the rig's mount and what the person marked before. Without them nothing is asked. */
  async start(detectionId: string, camera: string): Promise<void> {
    const detection = await cache.query(detections.detection(detectionId));
    const recording = await cache.query(recordings.recording(detection.recording_id));
    const rig = await cache.query(fleets.rig(recording.rig_id));
    const nominal = rig.cameras.find((one) => one.name === camera)?.nominal;
    this.nominal = nominal ? mountOf(nominal) : null;
    const before = (await annotations.ownPairs(detectionId, camera)).items;
    const given = this.pairs;
    const isNew = (id: string): boolean => !given.some((one) => one.vertexId === id);
    this.pairs = [
      ...before.map((one) => ({ ...one, vertexId: one.vertex_id })).filter((one) => isNew(one.vertexId)),
      ...given,
    ];
    this.stale = true;
  }

  /** A vertex is shown: an earlier mark of it does not predict its new one. */
  show(task: TaskView): void {
    this.dismiss();
    const others = this.pairs.filter((one) => one.vertexId !== task.vertex.id);
    this.stale ||= others.length < this.pairs.length;
    this.pairs = others;
  }

  /** Fits the camera to the marks so far; takes milliseconds. */
  learn({ frame }: TaskView): void {
    if (!this.stale || !this.nominal) return;
    this.expected = expectationOf(this.pairs, this.nominal, frame);
    this.stale = false;
  }

  /** Whether the person is asked about this mark. */
  asks(task: TaskView, mark: Pixel): boolean {
    this.question = this.expected?.doubts(placeOf(task), mark) ?? null;
    return this.question !== null;
  }

  dismiss(): void {
    this.question = null;
  }

  /** Notes a mark that was given. */
  note(task: TaskView, { u, v }: Pixel): void {
    this.pairs = [...this.pairs, { ...placeOf(task), u, v, vertexId: task.vertex.id }];
    this.stale = true;
  }
}

/** Where the vertex was when the camera saw it. */
function placeOf({ moved, vertex }: TaskView): { x: number; y: number; z: number } {
  const { x, y, z } = moved ?? vertex;
  return { x, y, z };
}
