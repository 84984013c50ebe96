import { corrupt } from "./error";
import type { Layer } from "./layer";
import { frameOf, type KnownPlanes, type Prediction, toVector, type Frame } from "./planePrediction";
import { INTEGER_MODELS, Models, RangeDecoder } from "./rangeDecoder";
import { zstdDecompress } from "./zstd";

// FORMAT.md, "Packed planes".

const DIGITS = 32;

/** The place of a number, rounded to binary32, in the order of all floats; and the float at a place. */
class FloatOrder {
  private readonly bits = new Uint32Array(1);
  private readonly value = new Float32Array(this.bits.buffer);

  place(x: number): number {
    this.value[0] = x;
    const bits = this.bits[0]!;
    return (bits & 0x80000000 ? ~bits : bits | 0x80000000) >>> 0;
  }

  at(place: number): number {
    this.bits[0] = place & 0x80000000 ? place & 0x7fffffff : ~place;
    return this.value[0]!;
  }
}

/** How a packed plane becomes known: by its floats. */
function vectorOf(plane: Float32Array, { exact }: Frame): [number, number, number] {
  const [distance, nx, ny, nz] = plane as unknown as [number, number, number, number];
  const scale = 2 ** 28 / ((nx * exact[0]! + ny * exact[1]! + nz * exact[2]!) * distance);
  const vector = [nx, ny, nz].map((n) => Math.floor(n * scale + 0.5));
  return vector.every((x) => Math.abs(x) < 2 ** 30) ? (vector as [number, number, number]) : [0, 0, 0];
}

/** Decodes a layer of exact planes into `planes`, four floats for each lattice index. */
export function readPackedPlanes(bytes: Uint8Array, layer: Layer, count: number, known: KnownPlanes, planes: Float32Array): void {
  const models = new Models(4 + 256 + 15 * INTEGER_MODELS);
  const at = { block: models.take(4), member: models.take(256), distance: models.take(3 * INTEGER_MODELS), normal: models.take(9 * INTEGER_MODELS), last: models.take(3 * INTEGER_MODELS) };
  // The stream says itself how long it is, so it is begun with all bytes and then again with its own.
  const frameBytes = new RangeDecoder(bytes, new Models(0)).plain(32);
  if (frameBytes > bytes.length) corrupt("The frame of a packed CELL is longer than its layer.");
  const end = bytes.length - frameBytes;
  const decoder = new RangeDecoder(bytes.subarray(0, end), models);
  decoder.plain(32);
  const indices = layer.readIndex(decoder, at.block, at.member, count);
  const content = frameBytes > 0 ? readFrame(bytes.subarray(end), indices.length) : null;
  const order = new FloatOrder();
  indices.forEach((index, k) => {
    const frame = frameOf(layer.lattice, index);
    const plane = planes.subarray(4 * index, 4 * index + 4);
    if (content) plane.set(planeOfFrame(content, k, indices.length));
    else readPlane(decoder, plane, known.predict(layer.neighbours(index), frame, layer.sphereOf(index).points), frame, at, order);
    known.add(index, vectorOf(plane, frame));
  });
  decoder.end();
}

function readFrame(bytes: Uint8Array, count: number): Uint8Array {
  const content = zstdDecompress(bytes, 16 * count);
  if (content.length !== 16 * count) corrupt(`The frame of a packed CELL holds ${content.length} bytes for ${count} planes.`);
  return content;
}

function planeOfFrame(content: Uint8Array, k: number, count: number): Float32Array {
  const bytes = Uint8Array.from({ length: 16 }, (_, i) => content[i * count + k]!);
  return new Float32Array(bytes.buffer);
}

function readPlane(
  decoder: RangeDecoder,
  plane: Float32Array,
  prediction: Prediction,
  frame: Frame,
  at: { distance: number; normal: number; last: number },
  order: FloatOrder,
): void {
  const e = Math.min(prediction.agreeing, 2);
  const p = toVector(frame.whole, prediction.w, prediction.s1, prediction.s2);
  const norm = Math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  const sizes = p.map(Math.abs);
  const last = sizes.indexOf(Math.max(...sizes));
  const read = (models: number, predicted: number): number =>
    order.at((order.place(predicted) + decoder.integer(models, DIGITS) + 2 ** 32) % 2 ** 32);
  plane[0] = read(at.distance + INTEGER_MODELS * e, 2 ** 28 / prediction.w);
  for (let axis = 0; axis < 3; ++axis) {
    if (axis !== last) plane[1 + axis] = read(at.normal + INTEGER_MODELS * (3 * axis + e), -p[axis]! / norm);
  }
  const [a, b] = [plane[1 + ((last + 1) % 3)]!, plane[1 + ((last + 2) % 3)]!];
  const rest = Math.sqrt(Math.max(0, 1 - a * a - b * b));
  plane[1 + last] = read(at.last + INTEGER_MODELS * last, p[last]! > 0 ? -rest : rest);
}
