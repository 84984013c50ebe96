import type { Cell } from "../format/cell";
import type { Lattice } from "../format/lattice";

/**
 * The patches of a CELL as the graphics processor reads them. `centers` holds x, y, z in the cell frame and the angular
 * radius of the lattice patch; `normals` two 16-bit octahedral coordinates. They are in an order of which every beginning
 * is an even, coarser lattice: `levels[k]` patches are those of level k, 2^-k of all, and come first. `count` is how many the
 * CELL has. `indices` says which lattice point each patch is of.
 */
export interface PatchLayout {
  count: number;
  centers: Float32Array;
  normals: Int16Array;
  indices: Uint32Array;
  levels: number[];
}

export const LEVELS = 8;

/** The inverse of the plastic number: its multiples fill the unit interval evenly, and beside those of the golden ratio. */
const ALPHA = 0.7548776662466927;

/** Level k holds the lattice points whose fraction is below 2^-k: any part of the sphere keeps its share, without arms. */
function levelOf(index: number): number {
  const fraction = (index * ALPHA) % 1;
  return Math.min(LEVELS - 1, Math.floor(-Math.log2(Math.max(fraction, 2 ** -LEVELS))));
}

function octahedral(x: number, y: number, z: number, out: Int16Array, at: number): void {
  const scale = 32767 / (Math.abs(x) + Math.abs(y) + Math.abs(z));
  let u = x * scale;
  let v = y * scale;
  if (z < 0) {
    const fold = (32767 - Math.abs(v)) * (u >= 0 ? 1 : -1);
    v = (32767 - Math.abs(u)) * (v >= 0 ? 1 : -1);
    u = fold;
  }
  out[at] = Math.round(u);
  out[at + 1] = Math.round(v);
}

/** The angular radius of each lattice point's patch: the disc of its mean solid angle, 2 / sqrt(points of its sphere). */
function radiusOf(lattice: Lattice): (index: number) => number {
  const ends: number[] = [];
  let end = 0;
  for (const sphere of lattice.spheres) ends.push((end += sphere.taken.length));
  return (index) => 2 / Math.sqrt(lattice.spheres[ends.findIndex((e) => index < e)]!.points);
}

/** The coarse layer of a coded CELL has a quarter of the patches: what is its all is level 2 of the whole. */
export const COARSE_LAYER_LEVEL = 2;

export function layOutPatches(cell: Cell, lattice: Lattice, isCoarseLayer = false): PatchLayout {
  const count = cell.indices.length;
  const counts = new Array<number>(LEVELS).fill(0);
  for (const index of cell.indices) ++counts[levelOf(index)]!;
  const levels = new Array<number>(LEVELS).fill(0);
  const next = new Array<number>(LEVELS).fill(0);
  for (let level = LEVELS - 1, sum = 0; level >= 0; --level) {
    next[level] = sum;
    levels[level] = sum += counts[level]!;
  }
  const centers = new Float32Array(4 * count);
  const normals = new Int16Array(2 * count);
  const indices = new Uint32Array(count);
  const radius = radiusOf(lattice);
  cell.indices.forEach((index, k) => {
    const slot = next[levelOf(index)]!++;
    indices[slot] = index;
    const distance = cell.planes[4 * k]!;
    for (let axis = 0; axis < 3; ++axis) centers[4 * slot + axis] = distance * lattice.directions[3 * index + axis]!;
    centers[4 * slot + 3] = radius(index);
    octahedral(cell.planes[4 * k + 1]!, cell.planes[4 * k + 2]!, cell.planes[4 * k + 3]!, normals, 2 * slot);
  });
  if (!isCoarseLayer) return { count, centers, normals, indices, levels };
  const ofWhole = levels.map((_, level) => levels[Math.max(0, level - COARSE_LAYER_LEVEL)]!);
  return { count: count << COARSE_LAYER_LEVEL, centers, normals, indices, levels: ofWhole };
}
