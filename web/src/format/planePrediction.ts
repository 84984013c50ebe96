import type { Lattice } from "./lattice";

// FORMAT.md, "Predicted planes": planes as inverse-range vectors in whole steps of 2^-28 per metre.

const LIMIT = 2 ** 30;
const shifted = (x: number): number => Math.floor(x / 2 ** 20);
const clamp = (x: number, low: number, high: number): number => Math.min(high, Math.max(low, x));

/** Direction, t1 and t2 of a patch: nine doubles, and the same as integers. */
export interface Frame {
  exact: number[];
  whole: number[];
}

export function frameOf(lattice: Lattice, index: number): Frame {
  const [x, y, z] = lattice.directions.subarray(3 * index, 3 * index + 3) as unknown as [number, number, number];
  const h = Math.sqrt(x * x + y * y);
  const [tx, ty] = h === 0 ? [1, 0] : [-y / h, x / h];
  const exact = [x, y, z, tx, ty, 0, -z * ty, z * tx, x * ty - y * tx];
  return { exact, whole: exact.map((c) => Math.floor(c * 2 ** 20 + 0.5)) };
}

/** What the neighbours say of a plane: its numbers in the patch's frame, how they differ, how many agree. */
export interface Prediction {
  w: number;
  s1: number;
  s2: number;
  spread: number;
  slopeSpread: number;
  agreeing: number;
  /** Some that counts does not agree. */
  out: boolean;
}

function inRange(w: number, s1: number, s2: number): boolean {
  return w > 0 && w < LIMIT && Math.abs(s1) < LIMIT && Math.abs(s2) < LIMIT;
}

/** The planes that were decoded so far, by lattice index. */
export class KnownPlanes {
  private readonly vectors: Float64Array;
  private readonly known: Uint8Array;
  private last: [number, number] = [0, 0];

  constructor(count: number) {
    this.vectors = new Float64Array(3 * count);
    this.known = new Uint8Array(count);
  }

  has(index: number): boolean {
    return this.known[index] === 1;
  }

  /** By its numbers in the patch's frame; what is not in range is not known. */
  addInFrame(index: number, { whole }: Frame, w: number, s1: number, s2: number): void {
    if (inRange(w, s1, s2)) this.add(index, toVector(whole, w, s1, s2));
  }

  add(index: number, vector: [number, number, number]): void {
    this.vectors.set(vector, 3 * index);
    this.known[index] = 1;
    this.last = [vector[0], vector[1]];
  }

  /** From the known planes among these lattice indices, in this order. */
  predict(neighbours: number[], { whole }: Frame): Prediction {
    const counting: [number, number, number][] = [];
    let seen = 0;
    for (const index of neighbours) {
      if (index < 0 || !this.has(index)) continue;
      if (++seen > 6) break;
      const plane = this.inFrame(index, whole);
      if (inRange(...plane)) counting.push(plane);
    }
    if (counting.length === 0) {
      const w = clamp(Math.abs(this.last[0]) + Math.abs(this.last[1]), 2 ** 21, LIMIT - 1);
      return { w, s1: 0, s2: 0, spread: 0, slopeSpread: 0, agreeing: 0, out: false };
    }
    const median = counting.map(([w]) => w).sort((a, b) => a - b)[Math.floor(counting.length / 2)]!;
    const agreeing = counting.filter(([w]) => Math.abs(w - median) <= Math.floor(median / 16));
    const mean = (k: 0 | 1 | 2): number => Math.floor(agreeing.reduce((sum, plane) => sum + plane[k], 0) / agreeing.length);
    const [w, s1, s2] = [mean(0), mean(1), mean(2)];
    const spread = (k: 0 | 1 | 2, about: number): number => agreeing.reduce((sum, plane) => sum + Math.abs(plane[k] - about), 0);
    return {
      w,
      s1,
      s2,
      spread: spread(0, w),
      slopeSpread: spread(1, s1) + spread(2, s2),
      agreeing: agreeing.length,
      out: agreeing.length < counting.length,
    };
  }

  private inFrame(index: number, frame: number[]): [number, number, number] {
    const [x, y, z] = this.vectors.subarray(3 * index, 3 * index + 3) as unknown as [number, number, number];
    const along = (k: number): number => shifted(x * frame[k]! + y * frame[k + 1]! + z * frame[k + 2]!);
    return [along(0), along(3), along(6)];
  }
}

/** The inverse-range vector of a plane given in a patch's frame. */
export function toVector(frame: number[], w: number, s1: number, s2: number): [number, number, number] {
  const along = (axis: number): number => shifted(w * frame[axis]! + s1 * frame[3 + axis]! + s2 * frame[6 + axis]!);
  return [along(0), along(1), along(2)];
}
