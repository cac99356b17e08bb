/** The answers that this browser keeps until the service has them: one IndexedDB for all tabs and all people. */

import { openDB, type DBSchema, type IDBPDatabase } from "idb";
import type { NewAnswer } from "./api/types.ts";
import type { ProblemView } from "./api/schema.ts";

/** An answer with what is needed to send it, and to tell its person which one it is. */
export interface KeptAnswer extends NewAnswer {
  /** Answers are sent in this order. */
  order: number;
  person: string;
  personName: string;
  taskId: string;
  detectionId: string;
  camera: string;
  vertexId: string;
  frameIndex: number;
  /** Why the service does not take it, until its person decides. */
  refused: ProblemView | null;
}

interface Schema extends DBSchema {
  answers: { key: number; value: Omit<KeptAnswer, "order"> & { order?: number } };
}

let opened: Promise<IDBPDatabase<Schema>> | undefined;

function database(): Promise<IDBPDatabase<Schema>> {
  opened ??= openDB<Schema>("apexcal", 1, {
    upgrade: (made) => {
      made.createObjectStore("answers", { keyPath: "order", autoIncrement: true });
    },
    // Another tab with newer pages waits for this one, which opens again at its next use.
    blocking: (_current, _blocked, event) => {
      (event.target as IDBDatabase).close();
      opened = undefined;
    },
    terminated: () => (opened = undefined),
  }).catch((error: unknown) => {
    opened = undefined;
    throw error;
  });
  return opened;
}

/** Everybody's, in the order in which they were given. */
export async function all(): Promise<KeptAnswer[]> {
  return (await (await database()).getAll("answers")) as KeptAnswer[];
}

/** Keeps an answer; once this is done it survives the page, and the browser. Returns its order. */
export async function add(answer: Omit<KeptAnswer, "order">): Promise<number> {
  const transaction = (await database()).transaction("answers", "readwrite", { durability: "strict" });
  const [order] = await Promise.all([transaction.store.add(answer), transaction.done]);
  return order;
}

export async function replace(answer: KeptAnswer): Promise<void> {
  await (await database()).put("answers", answer);
}

export async function remove(order: number): Promise<void> {
  await (await database()).delete("answers", order);
}
