/**
 * The service's hints that something changed, by server-sent events. Whoever hears one reads the state again, so a
 * missed hint costs freshness only. One connection per fleet, and none while the page is hidden: a browser opens
 * only six connections to a host over HTTP/1.1.
 */

export interface Hint {
  kind: string;
  id: string;
}

type Listener = (hint: Hint) => void;

class Stream {
  private source: EventSource | null = null;
  private readonly fleetId: string;
  readonly listeners = new Set<Listener>();

  constructor(fleetId: string) {
    this.fleetId = fleetId;
  }

  readonly follow = (): void => {
    if (document.visibilityState === "hidden" || this.listeners.size === 0) {
      this.source?.close();
      this.source = null;
    } else if (!this.source) {
      this.source = new EventSource(`/v1/fleets/${this.fleetId}/events`);
      // What changed while nobody listened is not known: everybody reads again.
      this.source.addEventListener("open", () => this.tell({ kind: "", id: "" }));
      this.source.addEventListener("changed", (event) => this.tell(JSON.parse(event.data) as Hint));
    }
  };

  private tell(hint: Hint): void {
    for (const listener of this.listeners) listener(hint);
  }
}

const streams = new Map<string, Stream>();

document.addEventListener("visibilitychange", () => {
  for (const stream of streams.values()) stream.follow();
});

/** Calls `listener` on each hint of the fleet; an empty hint means "anything may have changed". Returns the end of it. */
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
