/** A packed sweep as the service sends it, unpacked: docs/api.md has the layout. */

const MAGIC = 0x53585041; // "APXS" in little-endian order
const LAYOUT = 2;
const HEADER_BYTES = 36;

export interface Sweep {
  count: number;
  ringCount: number;
  /** x, y, z of each point in metres, LiDAR frame: ordered by ring, within a ring as the sensor gave them. */
  positions: Float32Array;
  rings: Uint16Array;
  intensities: Float32Array;
  /** When each point was measured, relative to the stamp. */
  timesNs: Float64Array;
}

/** Throws an Error for bytes that are no sweep of this layout. */
export async function unpack(packed: Uint8Array<ArrayBuffer>): Promise<Sweep> {
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return decode(await new Response(unpacked).arrayBuffer());
}

function decode(body: ArrayBuffer): Sweep {
  const view = new DataView(body);
  if (body.byteLength < HEADER_BYTES || view.getUint32(0, true) !== MAGIC || view.getUint16(4, true) !== LAYOUT) {
    throw new Error("The service sent a sweep in a layout that this page does not know. Reload the page.");
  }
  const ringCount = view.getUint16(6, true);
  const count = view.getUint32(8, true);
  const columns = new Columns(new Uint8Array(body, HEADER_BYTES + 4 * ringCount), count);
  const positions = new Float32Array(3 * count);
  const step = view.getFloat64(12, true);
  for (let axis = 0; axis < 3; axis += 1) {
    columns.unfold((i, value) => (positions[3 * i + axis] = value * step));
  }
  const intensities = new Float32Array(count);
  const intensityStep = view.getFloat64(20, true);
  columns.pairs((i, value) => (intensities[i] = value * intensityStep));
  const timesNs = new Float64Array(count);
  const timeStepNs = view.getFloat64(28, true);
  columns.unfold((i, value) => (timesNs[i] = value * timeStepNs));
  return {
    count,
    ringCount,
    positions,
    rings: ringsOf(view, ringCount, count),
    intensities,
    timesNs,
  };
}

function ringsOf(view: DataView, ringCount: number, count: number): Uint16Array {
  const rings = new Uint16Array(count);
  let first = 0;
  for (let ring = 0; ring < ringCount; ring += 1) {
    const end = first + view.getUint32(HEADER_BYTES + 4 * ring, true);
    rings.fill(ring, first, end);
    first = end;
  }
  return rings;
}

/** Reads column after column; a column of b bytes is b planes of one byte, the lowest first. */
class Columns {
  readonly #bytes: Uint8Array;
  readonly #count: number;
  #at = 0;

  constructor(bytes: Uint8Array, count: number) {
    this.#bytes = bytes;
    this.#count = count;
  }

  #plane(): Uint8Array {
    const plane = this.#bytes.subarray(this.#at, this.#at + this.#count);
    this.#at += this.#count;
    return plane;
  }

  pairs(put: (i: number, value: number) => void): void {
    const [low, high] = [this.#plane(), this.#plane()];
    for (let i = 0; i < this.#count; i += 1) put(i, (low[i] ?? 0) | ((high[i] ?? 0) << 8));
  }

  /** Sums of folded differences modulo 2^24: 0, 1, 2, 3, ... mean 0, -1, 1, -2, ... */
  unfold(put: (i: number, value: number) => void): void {
    const [low, middle, high] = [this.#plane(), this.#plane(), this.#plane()];
    let value = 0;
    for (let i = 0; i < this.#count; i += 1) {
      const folded = (low[i] ?? 0) | ((middle[i] ?? 0) << 8) | ((high[i] ?? 0) << 16);
      value = ((value + ((folded >>> 1) ^ -(folded & 1))) << 8) >> 8;
      put(i, value);
    }
  }
}
