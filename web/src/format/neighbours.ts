import { goldenFraction, RADIANS_PER_UNIT, signed64ToNumber, type Sphere } from "./lattice";

// FORMAT.md, "Neighbours".

const BLOCK = 256;
const COUNT = 8;

/** The eight smallest steps of a belt of latitude: combinations a F + b F' with |a|, |b| <= reach. */
function steps(sphere: Sphere, block: number, reach: number, limit: number, multiple: number): number[] {
  const { points, m, o } = sphere;
  const q = Math.min(BLOCK * block + BLOCK / 2, points - 1);
  const a = Math.max(1, 2 * q + o);
  const r2 = Math.max(a * (2 * m - a), 1) / (m * m);
  const found = new Map<number, number>();
  for (let [f, next] = [1, 2]; f <= limit; [f, next] = [next, f + next]) {
    for (let i = -reach; i <= reach; ++i) {
      for (let j = -reach; j <= reach; ++j) {
        const d = i * f + j * next;
        if (d <= 0 || d > limit || d % multiple !== 0 || found.has(d)) continue;
        const [high, low] = goldenFraction(d);
        const azimuth = signed64ToNumber(high, low) * RADIANS_PER_UNIT;
        const height = (2 * d) / m;
        found.set(d, azimuth * azimuth * r2 + (height * height) / r2);
      }
    }
  }
  return [...found].sort((x, y) => x[1] - y[1] || x[0] - y[0]).slice(0, COUNT).map(([d]) => d);
}

/** Offsets of the neighbours of the points of one sphere, nearest first. */
export class Neighbourhood {
  private readonly lists = new Map<number, number[]>();

  constructor(private readonly sphere: Sphere) {}

  offsets(point: number): number[] {
    const key = 4 * Math.floor(point / BLOCK) + (point % 4);
    let list = this.lists.get(key);
    if (!list) this.lists.set(key, (list = this.make(Math.floor(point / BLOCK), point % 4)));
    return list;
  }

  private make(block: number, rest: number): number[] {
    const limit = Math.floor(16 * Math.sqrt(this.sphere.points)) + 32;
    if (rest === 0) return steps(this.sphere, block, 4, limit, 4).map((d) => -d);
    return steps(this.sphere, block, 2, Math.floor(limit / 2), 1)
      .flatMap((d) => ((rest + d) % 4 === 0 ? [-d, d] : [-d]))
      .slice(0, COUNT);
  }
}
