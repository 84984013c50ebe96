import { unsupported } from "./error";

/** Names one fixed order of directions (FORMAT.md, "Lattices"). */
export interface LatticeId {
  kind: "fibonacci" | "fibonacci-bands";
  size: number;
}

/** A Fibonacci sphere of `points` points; `m` and `o` as in FORMAT.md, "Neighbours". */
export interface Sphere {
  points: number;
  m: number;
  o: 0 | 1;
  /** Position on the sphere of each lattice point that is taken from it, ascending. */
  taken: Uint32Array;
}

/** The directions of a lattice, x y z for each point, and the spheres that they are of, in order. */
export interface Lattice {
  id: LatticeId;
  count: number;
  directions: Float64Array;
  spheres: Sphere[];
}

const GOLDEN_HIGH = 0x9e3779b9;
const GOLDEN_LOW = 0x7f4a7c15;
const TWO_32 = 2 ** 32;
export const RADIANS_PER_UNIT = 2 * Math.PI * 2 ** -64;

/** i * 0x9E3779B97F4A7C15 mod 2^64 as its high and low 32 bits. Exact for i < 2^20. */
export function goldenFraction(i: number): [high: number, low: number] {
  const low = i * GOLDEN_LOW;
  const high = i * GOLDEN_HIGH + Math.floor(low / TWO_32);
  return [high % TWO_32, low % TWO_32];
}

/** double(int64(high, low)): one rounding, because both summands are exact. */
export function signed64ToNumber(high: number, low: number): number {
  return (high | 0) * TWO_32 + low;
}

/** cos and sin of i / phi turns, to the same bits on every machine. */
function goldenCosSin(i: number): [cos: number, sin: number] {
  const [high, low] = goldenFraction(i);
  const q = ((high + 2 ** 29) >>> 0) >>> 30;
  const x = signed64ToNumber((high - q * 2 ** 30) >>> 0, low) * RADIANS_PER_UNIT;
  const x2 = x * x;
  let s = 1;
  let c = 1;
  for (let n = 16; n >= 2; n -= 2) {
    s = 1 - (x2 / (n * (n + 1))) * s;
    c = 1 - (x2 / (n * (n - 1))) * c;
  }
  s *= x;
  if (q === 0) return [c, s];
  if (q === 1) return [-s, c];
  if (q === 2) return [-c, -s];
  return [s, -c];
}

/** r cos, r sin and the height along the axis of point i of a sphere. */
function spherePoint(i: number, m: number, o: 0 | 1): [u: number, v: number, height: number] {
  const a = 2 * i + o;
  const b = 2 * m - a;
  const radius = Math.sqrt(a * b) / m;
  const [cos, sin] = goldenCosSin(i);
  return [radius * cos, radius * sin, (m - a) / m];
}

function fibonacci(size: number): Lattice {
  const directions = new Float64Array(3 * size);
  const taken = new Uint32Array(size);
  for (let i = 0; i < size; ++i) {
    directions.set(spherePoint(i, size, 1), 3 * i);
    taken[i] = i;
  }
  return { id: { kind: "fibonacci", size }, count: size, directions, spheres: [{ points: size, m: size, o: 1, taken }] };
}

const BANDS: { points: (size: number) => number; holds: (z: number) => boolean }[] = [
  { points: (size) => size, holds: (z) => z >= -0.2 && z < 0.7 },
  { points: (size) => 2 * size, holds: (z) => z >= -0.6 && z < -0.2 },
  { points: (size) => Math.floor(size / 200), holds: (z) => z < -0.6 },
];

function fibonacciBands(size: number): Lattice {
  const directions: number[] = [];
  const spheres = BANDS.map((band): Sphere => {
    const points = band.points(size);
    const taken: number[] = [];
    for (let i = 0; i < points; ++i) {
      const [x, z, y] = spherePoint(i, points - 1, 0); // the axis is y
      if (!band.holds(z)) continue;
      taken.push(i);
      directions.push(x, y, z);
    }
    return { points, m: points - 1, o: 0, taken: Uint32Array.from(taken) };
  });
  return {
    id: { kind: "fibonacci-bands", size },
    count: directions.length / 3,
    directions: Float64Array.from(directions),
    spheres,
  };
}

/** Checks the numbers by which a file names its lattice. */
export function latticeId(kind: number, version: number, size: number): LatticeId {
  const largest = [0, 1_000_000, 500_000][kind] ?? 0;
  if (version !== 1 || !(size >= 1000 && size <= largest)) {
    unsupported(`Lattice kind ${kind}, version ${version}, size ${size} is not one that can be read.`);
  }
  return { kind: kind === 1 ? "fibonacci" : "fibonacci-bands", size };
}

/** Makes lattices and keeps the last few: one has 1.2 MB of directions at the usual size and takes 10 ms. */
export class Lattices {
  private readonly kept = new Map<string, Lattice>();

  get(id: LatticeId): Lattice {
    const key = `${id.kind} ${id.size}`;
    let lattice = this.kept.get(key);
    if (!lattice) {
      lattice = id.kind === "fibonacci" ? fibonacci(id.size) : fibonacciBands(id.size);
      if (this.kept.size >= 4) this.kept.delete(this.kept.keys().next().value!);
    }
    this.kept.delete(key);
    this.kept.set(key, lattice);
    return lattice;
  }
}
