// Symmetric 6x6 matrices as their upper triangles by rows: 21 numbers.

const at = (i: number, j: number): number => (i <= j ? (i * (11 - i)) / 2 + j : at(j, i));

export function trace(upper: Float64Array): number {
  let sum = 0;
  for (let i = 0; i < 6; ++i) sum += upper[at(i, i)]!;
  return sum;
}

/**
 * Whether no eigenvalue lies below -1e-6 of the largest coefficient, what rounding may leave of 0: by elimination of
 * the matrix with that much added to its diagonal.
 */
export function isPositiveSemidefinite(upper: Float64Array): boolean {
  const slack = 1e-6 * upper.reduce((largest, x) => Math.max(largest, Math.abs(x)), 0);
  const m: number[][] = [];
  for (let i = 0; i < 6; ++i) m.push(Array.from({ length: 6 }, (_, j) => upper[at(i, j)]! + (i === j ? slack : 0)));
  for (let k = 0; k < 6; ++k) {
    const pivot = m[k]![k]!;
    if (!(pivot > 0)) return false;
    for (let i = k + 1; i < 6; ++i) {
      const factor = m[i]![k]! / pivot;
      for (let j = k + 1; j < 6; ++j) m[i]![j]! -= factor * m[k]![j]!;
    }
  }
  return true;
}
