/** Small symmetric systems. */

export type Rows = readonly Float64Array[];

export const dot = (a: Float64Array, b: Float64Array): number => a.reduce((sum, one, i) => sum + one * (b[i] ?? 0), 0);

/** The inverse of a positive definite matrix by Gauss and Jordan; null if it is singular. */
export function inverseOf(matrix: Rows): Float64Array[] | null {
  const size = matrix.length;
  const work = matrix.map((row, i) =>
    Float64Array.from({ length: 2 * size }, (_, j) => row[j] ?? (j - size === i ? 1 : 0)),
  );
  for (let column = 0; column < size; column += 1) {
    const pivot = work[column] ?? new Float64Array();
    const head = pivot[column] ?? 0;
    if (!(head > Number.EPSILON)) return null;
    for (let j = 0; j < 2 * size; j += 1) pivot[j] = (pivot[j] ?? 0) / head;
    for (const row of work) {
      const share = row[column] ?? 0;
      if (row === pivot || share === 0) continue;
      for (let j = 0; j < 2 * size; j += 1) row[j] = (row[j] ?? 0) - share * (pivot[j] ?? 0);
    }
  }
  return work.map((row) => row.slice(size));
}
