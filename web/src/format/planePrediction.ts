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

/** A plane around a patch: in the patch's frame, in the CELL's, and where its own patch is. */
interface Around {
  patch: [number, number, number];
  vector: [number, number, number];
  direction: [number, number, number];
}

const sum = (values: number[]): number => values.reduce((a, b) => a + b, 0);
const dot = (a: ArrayLike<number>, b: ArrayLike<number>): number => a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;

/** The plane through the centres of those that agree, its slopes held to their mean, and twice how far they are from it. */
function fitted(frame: Frame, mean: [number, number, number], agreeing: Around[], held: number): { plane: [number, number, number]; spread: number } {
  const { exact, whole } = frame;
  const [t1, t2] = [exact.slice(3, 6), exact.slice(6, 9)];
  const at = toVector(whole, ...mean);
  const x = agreeing.map(({ direction: u }) => u[0] * t1[0]! + u[1] * t1[1]!);
  const y = agreeing.map(({ direction: u }) => dot(u, t2));
  const e = agreeing.map(({ vector: m, direction: u }) => dot([m[0] - at[0], m[1] - at[1], m[2] - at[2]], u));
  const share = 1 / agreeing.length;
  const average = (a: number[]): number => sum(a) * share;
  const covariance = (a: number[], b: number[]): number => sum(a.map((v, i) => v * b[i]!)) * share - average(a) * average(b);
  const [xx, yy, xy] = [covariance(x, x) + held, covariance(y, y) + held, covariance(x, y)];
  const [xe, ye] = [covariance(x, e), covariance(y, e)];
  const d = xx * yy - xy * xy;
  let [g1, g2] = [(xe * yy - ye * xy) / d, (ye * xx - xe * xy) / d];
  let dw = average(e) - g1 * average(x) - g2 * average(y);
  if (!(Math.abs(dw) <= 0.25 * mean[0])) dw = g1 = g2 = 0;
  const off = e.map((v, i) => Math.abs(v - (dw + g1 * x[i]! + g2 * y[i]!)));
  return { plane: [mean[0] + dw, mean[1] + g1, mean[2] + g2], spread: 2 * sum(off) };
}

/** The planes that were decoded so far, by lattice index. */
export class KnownPlanes {
  private readonly vectors: Float64Array;
  private readonly known: Uint8Array;
  private last: [number, number] = [0, 0];

  /** `fits`: whether a prediction is the plane through the centres of those that agree, not their mean. */
  constructor(
    private readonly lattice: Lattice,
    private readonly fits: boolean,
  ) {
    this.vectors = new Float64Array(3 * lattice.count);
    this.known = new Uint8Array(lattice.count);
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

  /** From the known planes among these lattice indices, in this order, on a sphere of so many points. */
  predict(neighbours: number[], frame: Frame, points: number): Prediction {
    const counting: Around[] = [];
    let seen = 0;
    for (const index of neighbours) {
      if (index < 0 || !this.has(index)) continue;
      if (++seen > 6) break;
      const around = this.around(index, frame.whole);
      if (inRange(...around.patch)) counting.push(around);
    }
    if (counting.length === 0) {
      const w = clamp(Math.abs(this.last[0]) + Math.abs(this.last[1]), 2 ** 21, LIMIT - 1);
      return { w, s1: 0, s2: 0, spread: 0, slopeSpread: 0, agreeing: 0, out: false };
    }
    const median = counting.map(({ patch }) => patch[0]).sort((a, b) => a - b)[Math.floor(counting.length / 2)]!;
    const agreeing = counting.filter(({ patch }) => Math.abs(patch[0] - median) <= Math.floor(median / 16));
    const of = (k: 0 | 1 | 2): number => Math.floor(sum(agreeing.map(({ patch }) => patch[k])) / agreeing.length);
    const mean: [number, number, number] = [of(0), of(1), of(2)];
    const { plane, spread } = this.fits
      ? fitted(frame, mean, agreeing, 2 / points)
      : { plane: mean, spread: sum(agreeing.map(({ patch }) => Math.abs(patch[0] - mean[0]))) };
    const [w, s1, s2] = plane;
    return {
      w,
      s1,
      s2,
      spread,
      slopeSpread: sum(agreeing.map(({ patch }) => Math.abs(patch[1] - s1) + Math.abs(patch[2] - s2))),
      agreeing: agreeing.length,
      out: agreeing.length < counting.length,
    };
  }

  private around(index: number, frame: number[]): Around {
    const vector = this.vectors.subarray(3 * index, 3 * index + 3) as unknown as [number, number, number];
    const [x, y, z] = vector;
    const along = (k: number): number => shifted(x * frame[k]! + y * frame[k + 1]! + z * frame[k + 2]!);
    const direction = this.lattice.directions.subarray(3 * index, 3 * index + 3) as unknown as [number, number, number];
    return { patch: [along(0), along(3), along(6)], vector, direction };
  }
}

/** The inverse-range vector of a plane given in a patch's frame. */
export function toVector(frame: number[], w: number, s1: number, s2: number): [number, number, number] {
  const along = (axis: number): number => shifted(w * frame[axis]! + s1 * frame[3 + axis]! + s2 * frame[6 + axis]!);
  return [along(0), along(1), along(2)];
}
