import { corrupt } from "./error";
import type { Lattice, Sphere } from "./lattice";
import { Neighbourhood } from "./neighbours";
import type { RangeDecoder } from "./rangeDecoder";

const BLOCK = 64;

/** One sphere of a lattice with what its points are. */
interface Part {
  sphere: Sphere;
  neighbourhood: Neighbourhood;
  /** Lattice index of its first point, and of each point of the sphere (-1: left out). */
  first: number;
  indexOf: Int32Array;
}

/** One of the two layers of a coded CELL (FORMAT.md, "Coded CELL"): 0 coarse, 1 fine. */
export class Layer {
  private readonly parts: Part[] = [];

  constructor(
    readonly lattice: Lattice,
    readonly number: 0 | 1,
    /** Which lattice indices have a plane, of both layers so far. */
    private readonly present: Uint8Array,
  ) {
    let first = 0;
    for (const sphere of lattice.spheres) {
      const indexOf = new Int32Array(sphere.points).fill(-1);
      sphere.taken.forEach((point, i) => (indexOf[point] = first + i));
      this.parts.push({ sphere, neighbourhood: new Neighbourhood(sphere), first, indexOf });
      first += sphere.taken.length;
    }
  }

  /** Reads which patches of this layer have a plane; `block` and `member` are numbers of models. */
  readIndex(decoder: RangeDecoder, block: number, member: number, count: number): number[] {
    const found: number[] = [];
    for (const part of this.parts) {
      let before = 0;
      for (let start = 0; start < part.sphere.taken.length; start += BLOCK) {
        const end = Math.min(start + BLOCK, part.sphere.taken.length);
        const coarse = this.number === 1 && this.hasCoarse(part, start, end) ? 1 : 0;
        before = decoder.bit(block + 2 * before + coarse);
        if (before) this.readBlock(decoder, part, start, end, member, found);
      }
    }
    if (found.length !== count) corrupt(`A layer of the coded CELL names ${found.length} patches; ${count} are stated.`);
    return found;
  }

  /** Lattice indices of the neighbours of a lattice index, nearest first; -1 for points that are none. */
  neighbours(index: number): number[] {
    const part = this.partOf(index);
    return this.neighboursIn(part, part.sphere.taken[index - part.first]!);
  }

  sphereOf(index: number): Sphere {
    return this.partOf(index).sphere;
  }

  private partOf(index: number): Part {
    return this.parts.findLast((part) => part.first <= index)!;
  }

  private neighboursIn({ neighbourhood, indexOf }: Part, point: number): number[] {
    return neighbourhood.offsets(point).map((offset) => indexOf[point + offset] ?? -1);
  }

  private hasCoarse({ sphere, first }: Part, start: number, end: number): boolean {
    for (let i = start; i < end; ++i) if (sphere.taken[i]! % 4 === 0 && this.present[first + i]) return true;
    return false;
  }

  private readBlock(decoder: RangeDecoder, part: Part, start: number, end: number, member: number, found: number[]): void {
    for (let i = start; i < end; ++i) {
      const point = part.sphere.taken[i]!;
      if ((point % 4 === 0) !== (this.number === 0)) continue;
      let context = 0;
      this.neighboursIn(part, point).forEach((neighbour, k) => {
        if (neighbour >= 0 && this.present[neighbour]) context |= 128 >> k;
      });
      if (!decoder.bit(member + context)) continue;
      this.present[part.first + i] = 1;
      found.push(part.first + i);
    }
  }
}
