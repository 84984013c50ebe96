import { corrupt } from "./error";
import { firstProbabilities } from "./firstProbabilities";
import type { Layer } from "./layer";
import { frameOf, type KnownPlanes } from "./planePrediction";
import { INTEGER_MODELS, Models, RangeDecoder } from "./rangeDecoder";

// FORMAT.md, "Compact planes".

const SCALE_MODELS = 18; // zero, negative, more[0][1 to 8], more[1][1 to 8]
const LOWEST_SCALE = 25;
const HIGHEST_SCALE = 12;
const DIGITS = 24;

const factor = (k: number): number => (k & 1 ? 1.5 : 1) * 2 ** (k >> 1);

function level(x: number, q: number): number {
  let n = 0;
  for (; n < 7 && !(x < q); q *= 2) ++n;
  return n;
}

/** Numbers of the models, in the order in which their first probabilities are listed; `kinds`: of steps that have models of their own. */
function takeModels(models: Models, kinds: number): Record<"block" | "member" | "scale" | "range" | "slope1" | "slope2", number> {
  return {
    block: models.take(4),
    member: models.take(256),
    scale: models.take(32 * SCALE_MODELS),
    range: models.take(32 * kinds * INTEGER_MODELS),
    slope1: models.take(24 * kinds * INTEGER_MODELS),
    slope2: models.take(24 * kinds * INTEGER_MODELS),
  };
}

function readScale(decoder: RangeDecoder, models: number): number {
  if (decoder.bit(models)) return 0;
  const negative = decoder.bit(models + 1);
  const most = negative ? LOWEST_SCALE : HIGHEST_SCALE;
  let magnitude = 1;
  while (magnitude < most && decoder.bit(models + 2 + 8 * negative + Math.min(magnitude, 8) - 1)) ++magnitude;
  return negative ? -magnitude : magnitude;
}

function readAsItIs(decoder: RangeDecoder, planes: Float32Array, index: number): void {
  const bits = new Uint32Array(1);
  const value = new Float32Array(bits.buffer);
  for (let i = 0; i < 4; ++i) {
    bits[0] = decoder.plain(32);
    planes[4 * index + i] = value[0]!;
  }
}

/** Decodes a layer of planes within `boundUm` micrometres into `planes`, four floats for each lattice index. */
export function readCompactPlanes(
  bytes: Uint8Array,
  layer: Layer,
  count: number,
  boundUm: number,
  version: 1 | 2,
  known: KnownPlanes,
  planes: Float32Array,
): void {
  const first = firstProbabilities(version, layer.number);
  const models = new Models(first.length, first);
  const at = takeModels(models, version === 1 ? 1 : 3);
  const decoder = new RangeDecoder(bytes, models);
  const bound = boundUm * 1e-6;
  const rangeShare = version === 1 ? 0.9 : 0.7;
  for (const index of layer.readIndex(decoder, at.block, at.member, count)) {
    const frame = frameOf(layer.lattice, index);
    const { points } = layer.sphereOf(index);
    const p = known.predict(layer.neighbours(index), frame, points);
    const rho = 2 / Math.sqrt(points);
    const i = 1 / p.w;
    const r = 2 ** 28 * i;
    const l1 = p.s1 * i;
    const l2 = p.s2 * i;
    const t = Math.sqrt(1 + l1 * l1 + l2 * l2);
    const rangeStep = (k: number): number => rangeShare * bound * factor(k) * t;
    const slopeStep = (k: number, range: number): number => (((1.8 * bound) / rho) * factor(k) * t) / range;
    const n = Math.min(p.agreeing, 5);
    const out = p.out ? 1 : 0;
    const row = 8 * (n < 2 ? n : n < 4 ? 2 : 3);

    const scaleLevel = n < 2 ? out : level(p.slopeSpread * i, slopeStep(0, r) * n);
    const k = readScale(decoder, at.scale + SCALE_MODELS * (row + scaleLevel));
    if (k === -LOWEST_SCALE) {
      readAsItIs(decoder, planes, index);
      continue;
    }
    const rangeLevel = n < 2 ? Math.min(7, Math.max(0, k + 3)) : level(2 * (p.spread * r * i), rangeStep(k) * n);
    const kind = version === 1 || k === 0 ? 0 : k < 0 ? 1 : 2;
    const a = decoder.integer(at.range + INTEGER_MODELS * (32 * kind + row + rangeLevel), DIGITS);
    const range = r + a * rangeStep(k);
    const step = slopeStep(k, range);
    const slopeLevel = n < 2 ? out : level(p.slopeSpread * i, Math.abs(step) * n);
    const slope = (group: number, context: number): number =>
      decoder.integer(group + INTEGER_MODELS * (24 * kind + 8 * Math.min(2, Math.abs(context)) + slopeLevel), DIGITS);
    const b = slope(at.slope1, a);
    const c = slope(at.slope2, b);
    const lean1 = l1 + b * step;
    const lean2 = l2 + c * step;
    if (!(range > 0 && range <= 10_000 && Number.isFinite(lean1) && Number.isFinite(lean2))) {
      corrupt(`The coded plane of lattice point ${index} lies at ${range} m.`);
    }
    const [ux, uy, uz, t1x, t1y, t1z, t2x, t2y, t2z] = frame.exact as [number, number, number, number, number, number, number, number, number];
    const v = [ux + lean1 * t1x + lean2 * t2x, uy + lean1 * t1y + lean2 * t2y, uz + lean1 * t1z + lean2 * t2z] as const;
    const toNormal = -1 / Math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    planes.set([range, v[0] * toNormal, v[1] * toNormal, v[2] * toNormal], 4 * index);
    const w = 2 ** 28 / range;
    const exact = [w, lean1 * w, lean2 * w] as const;
    if (exact.every((x) => Math.abs(x) < 2 ** 30)) {
      const [x, y, z] = exact.map((value) => Math.floor(value + 0.5)) as [number, number, number];
      known.addInFrame(index, frame, x, y, z);
    }
  }
  decoder.end();
}
