/**
 * The service's hints that something changed, by server-sent events. Whoever hears one reads the state again, so a
 * missed hint costs freshness only. One connection per fleet, and none while the page is hidden: a browser opens
 * only six connections to a host over HTTP/1.1.
 */

/** The kind of thing that changed, and its id. `fleet` means that anything of the fleet may have changed. */
export interface Hint {
  kind: string;
  id: string;
}

type Listener = (hint: Hint) => void;

const FIRST_PAUSE_MS = 1000;
const LONGEST_PAUSE_MS = 60_000;

class Stream {
  private source: EventSource | null = null;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private failures = 0;
  private readonly fleetId: string;
  readonly listeners = new Set<Listener>();

  constructor(fleetId: string) {
    this.fleetId = fleetId;
  }

  readonly follow = (): void => {
    if (document.visibilityState === "hidden" || this.listeners.size === 0) this.stop();
    else if (!this.source && this.timer === undefined) this.start();
  };

  private start(): void {
    const source = new EventSource(`/v1/fleets/${this.fleetId}/events`);
    source.addEventListener("open", () => (this.failures = 0));
    source.addEventListener("changed", (event) => {
      const hint = JSON.parse(event.data as string) as Hint;
      for (const listener of this.listeners) listener(hint);
    });
    source.addEventListener("error", () => {
      if (source.readyState === EventSource.CLOSED) this.retry();
    });
    this.source = source;
  }

  /** A browser gives up for good on an answer that is no stream, as the 503 of a full process is none. */
  private retry(): void {
    this.stop();
    const pause = Math.min(LONGEST_PAUSE_MS, FIRST_PAUSE_MS * 2 ** this.failures);
    this.failures += 1;
    this.timer = setTimeout(
      () => {
        this.timer = undefined;
        this.follow();
      },
      // Pages that were refused together do not come back in the same moment.
      pause * (0.5 + 0.5 * Math.random()),
    );
  }

  private stop(): void {
    this.source?.close();
    this.source = null;
    clearTimeout(this.timer);
    this.timer = undefined;
  }
}

const streams = new Map<string, Stream>();

document.addEventListener("visibilitychange", () => {
  for (const stream of streams.values()) stream.follow();
});

/** Calls `listener` on each hint of the fleet. Returns the end of it. */
export function onHint(fleetId: string, listener: Listener): () => void {
  const stream = streams.get(fleetId) ?? new Stream(fleetId);
  streams.set(fleetId, stream);
  stream.listeners.add(listener);
  stream.follow();
  return () => {
    stream.listeners.delete(listener);
    // A page that follows on the same fleet takes the connection over.
    setTimeout(stream.follow, 500);
  };
}
