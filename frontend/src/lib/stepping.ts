/** Sliders by keys: arrows step by one, Page keys by ten. */

const STEPS: Record<string, number> = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 };

/** Where a key leads from `number`, between 0 and `last`. */
export function stepped(event: KeyboardEvent, number: number, last: number): number {
  const step = STEPS[event.key];
  if (step === undefined) return number;
  event.preventDefault();
  return Math.min(last, Math.max(0, number + step));
}
