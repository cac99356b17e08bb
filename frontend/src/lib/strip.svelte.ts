/** The last marks that a person gave, each as a piece of its frame about the mark: one that lies elsewhere shows. */

import { loupeSource, type Pixel } from "./pixels.ts";

const MOST = 8;
/** Sides of a picture in CSS pixels, and how many times it is magnified. */
export const STRIP_SIDE = 56;
const MAGNIFICATION = 4;

export interface StripItem {
  taskId: string;
  picture: HTMLCanvasElement;
}

export class Strip {
  items = $state.raw<readonly StripItem[]>([]);

  add(taskId: string, image: HTMLImageElement, mark: Pixel): void {
    const picture = document.createElement("canvas");
    const density = Math.min(3, globalThis.devicePixelRatio || 1);
    picture.width = picture.height = STRIP_SIDE * density;
    const context = picture.getContext("2d");
    if (!context) return;
    const { x, y, side } = loupeSource(mark, STRIP_SIDE, MAGNIFICATION);
    context.drawImage(image, x, y, side, side, 0, 0, picture.width, picture.height);
    this.items = [...this.items.filter((item) => item.taskId !== taskId), { taskId, picture }].slice(-MOST);
  }

  remove(taskId: string): void {
    this.items = this.items.filter((item) => item.taskId !== taskId);
  }
}
