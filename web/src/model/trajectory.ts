import { Matrix4, Vector3 } from "three";

/** Positions of a drive's scans in order. */
export interface Trajectory {
  /** Seconds; empty where the file has none. */
  stamps: Float64Array;
  /** x, y, z of each scan, metres. */
  positions: Float64Array;
}

/** TUM (stamp, x, y, z, quaternion) or KITTI (twelve numbers of [R | t]) lines; `#` begins a comment. Throws Error. */
export function readTrajectory(text: string): Trajectory {
  const rows = text
    .split("\n")
    .map((line) => line.trim())
    .filter((line) => line !== "" && !line.startsWith("#"))
    .map((line) => line.split(/[\s,]+/).map(Number));
  const width = rows[0]?.length ?? 0;
  const sound = rows.length > 0 && (width === 8 || width === 12) && rows.every((row) => row.length === width && row.every(Number.isFinite));
  if (!sound) throw new Error("Expected a trajectory in TUM (8 numbers a line) or KITTI form (12 numbers a line).");
  const places = width === 8 ? [1, 2, 3] : [3, 7, 11];
  return {
    stamps: Float64Array.from(width === 8 ? rows.map((row) => row[0]!) : []),
    positions: Float64Array.from(rows.flatMap((row) => places.map((place) => row[place]!))),
  };
}

const count = ({ positions }: Trajectory): number => positions.length / 3;
const at = ({ positions }: Trajectory, i: number): Vector3 => new Vector3().fromArray(positions as unknown as number[], 3 * i);

/** Metres driven up to each scan. */
export function distances(trajectory: Trajectory): Float64Array {
  const along = new Float64Array(count(trajectory));
  for (let i = 1; i < along.length; ++i) along[i] = along[i - 1]! + at(trajectory, i).distanceTo(at(trajectory, i - 1));
  return along;
}

/**
 * The rigid motion that brings the first trajectory's positions nearest to those of the second (Horn 1987: the quaternion is
 * the eigenvector of a 4x4 matrix, here by repeated squaring), row i with row i.
 */
export function bestFit(from: Trajectory, to: Trajectory): Matrix4 {
  const n = Math.min(count(from), count(to));
  const [a, b] = [new Vector3(), new Vector3()];
  for (let i = 0; i < n; ++i) {
    a.addScaledVector(at(from, i), 1 / n);
    b.addScaledVector(at(to, i), 1 / n);
  }
  const s = Array.from({ length: 3 }, () => [0, 0, 0]);
  for (let i = 0; i < n; ++i) {
    const p = at(from, i).sub(a).toArray();
    const q = at(to, i).sub(b).toArray();
    for (let r = 0; r < 3; ++r) for (let c = 0; c < 3; ++c) s[r]![c]! += p[r]! * q[c]!;
  }
  const [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s as [[number, number, number], [number, number, number], [number, number, number]];
  const [w, x, y, z] = largestEigenvector([
    [xx + yy + zz, yz - zy, zx - xz, xy - yx],
    [yz - zy, xx - yy - zz, xy + yx, zx + xz],
    [zx - xz, xy + yx, -xx + yy - zz, yz + zy],
    [xy - yx, zx + xz, yz + zy, -xx - yy + zz],
  ]);
  const turn = new Matrix4().set(
    1 - 2 * (y! * y! + z! * z!), 2 * (x! * y! - w! * z!), 2 * (x! * z! + w! * y!), 0,
    2 * (x! * y! + w! * z!), 1 - 2 * (x! * x! + z! * z!), 2 * (y! * z! - w! * x!), 0,
    2 * (x! * z! - w! * y!), 2 * (y! * z! + w! * x!), 1 - 2 * (x! * x! + y! * y!), 0,
    0, 0, 0, 1,
  );
  return turn.setPosition(b.sub(a.applyMatrix4(turn)));
}

/** Of a symmetric 4x4 matrix, by powers of it: shifted so that its largest eigenvalue is also the largest in size. */
function largestEigenvector(matrix: number[][]): number[] {
  const size = Math.sqrt(matrix.flat().reduce((sum, v) => sum + v * v, 0)) || 1;
  let power = matrix.map((row, i) => row.map((v, j) => v / size + (i === j ? 1 : 0)));
  for (let step = 0; step < 50; ++step) {
    const squared = power.map((row) => row.map((_, j) => row.reduce((sum, v, k) => sum + v * power[k]![j]!, 0)));
    const largest = Math.max(...squared.flat().map(Math.abs));
    power = squared.map((row) => row.map((v) => v / largest));
  }
  const best = power.reduce((a, b) => (Math.hypot(...b) > Math.hypot(...a) ? b : a));
  const norm = Math.hypot(...best);
  return best.map((v) => v / norm);
}

/** How far apart two drives are, scan by scan, metres, after the first was moved by `motion`. */
export function errors(from: Trajectory, to: Trajectory, motion: Matrix4): Float64Array {
  const n = Math.min(count(from), count(to));
  return Float64Array.from({ length: n }, (_, i) => at(from, i).applyMatrix4(motion).distanceTo(at(to, i)));
}

export const rms = (values: Float64Array): number => Math.sqrt(values.reduce((sum, v) => sum + v * v, 0) / Math.max(1, values.length));
