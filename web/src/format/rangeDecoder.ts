import { corrupt } from "./error";

// FORMAT.md, "Range coding". Numbers stay below 2^40 and are exact in doubles.

/** Models by number: their fast and slow probabilities of a 1. */
export class Models {
  private readonly fast: Uint16Array;
  private readonly slow: Uint16Array;
  private used = 0;

  /** `first`: the models' first probabilities in units of 1/256; 128 beyond its end. */
  constructor(
    count: number,
    private readonly first: Uint8Array = new Uint8Array(),
  ) {
    this.fast = new Uint16Array(count);
    this.slow = new Uint16Array(count);
  }

  /** The number of the next `count` models, which begin with their first probabilities. */
  take(count: number): number {
    const at = this.used;
    for (; this.used < at + count; ++this.used) {
      this.fast[this.used] = this.slow[this.used] = 256 * (this.first[this.used] ?? 128);
    }
    return at;
  }

  probability(model: number): number {
    return (this.fast[model]! + this.slow[model]!) >> 2;
  }

  update(model: number, bit: number): void {
    const [f, s] = [this.fast[model]!, this.slow[model]!];
    this.fast[model] = bit ? f + ((65535 - f) >> 4) : f - (f >> 4);
    this.slow[model] = bit ? s + ((65535 - s) >> 7) : s - (s >> 7);
  }
}

/** The models of an integer: `zero`, `more[10]`, `second[10]`. */
export const INTEGER_MODELS = 21;

/** Decodes one stream. Beyond its end it goes on with zeros; `end` then refuses it. */
export class RangeDecoder {
  private range = 2 ** 32 - 1;
  private code = 0;
  private at = 0;

  constructor(
    private readonly bytes: Uint8Array,
    private readonly models: Models,
  ) {
    for (let i = 0; i < 4; ++i) this.code = this.code * 256 + this.next();
  }

  bit(model: number): number {
    const bound = Math.floor(this.range / 32768) * this.models.probability(model);
    const bit = this.code < bound ? 1 : 0;
    if (bit) {
      this.range = bound;
    } else {
      this.code -= bound;
      this.range -= bound;
    }
    this.models.update(model, bit);
    this.refill();
    return bit;
  }

  /** A number of n plain bits, at most 32: the highest 16 first. */
  plain(n: number): number {
    let value = 0;
    for (let left = n; left > 0; ) {
      const group = Math.min(left, 16);
      this.range = Math.floor(this.range / 2 ** group);
      const digit = Math.min(Math.floor(this.code / this.range), 2 ** group - 1);
      this.code -= digit * this.range;
      this.refill();
      value = value * 2 ** group + digit;
      left -= group;
    }
    return value;
  }

  /** A signed integer of at most `digits` binary digits; `models` as INTEGER_MODELS says. */
  integer(models: number, digits: number): number {
    if (this.bit(models)) return 0;
    const sign = this.plain(1) ? -1 : 1;
    let r = 0;
    while (r + 1 < digits && this.bit(models + 1 + Math.min(r, 9))) ++r;
    let magnitude = 1;
    if (r > 0) magnitude = 2 + this.bit(models + 11 + Math.min(r, 9));
    if (r > 1) magnitude = magnitude * 2 ** (r - 1) + this.plain(r - 1);
    return sign * magnitude;
  }

  /** Refuses a stream that was too short or too long. */
  end(): void {
    if (this.at !== this.bytes.length) corrupt(`The coded planes take ${this.at} bytes; there are ${this.bytes.length}.`);
  }

  private refill(): void {
    while (this.range < 2 ** 24) {
      this.code = this.code * 256 + this.next();
      this.range *= 256;
    }
  }

  private next(): number {
    return this.bytes[this.at++] ?? 0;
  }
}
