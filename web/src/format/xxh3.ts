// XXH3 with 64 bits and seed 0, the sums of archives (FORMAT.md, "Archive").

const SECRET_DIGITS =
  "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221" +
  "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8" +
  "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb" +
  "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e";

const MASK = (1n << 64n) - 1n;
const P32_1 = 0x9e3779b1n;
const P32_2 = 0x85ebca77n;
const P32_3 = 0xc2b2ae3dn;
const P64_1 = 0x9e3779b185ebca87n;
const P64_2 = 0xc2b2ae3d27d4eb4fn;
const P64_3 = 0x165667b19e3779f9n;
const P64_4 = 0x85ebca77c2b2ae63n;
const P64_5 = 0x27d4eb2f165667c5n;
const MIX_1 = 0x165667919e3779f9n;
const MIX_2 = 0x9fb21c651e98df25n;

const STRIPE = 64;
const STRIPES_PER_BLOCK = 16;

const view = (bytes: Uint8Array): DataView => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
const r64 = (data: DataView, at: number): bigint => data.getBigUint64(at, true);
const r32 = (data: DataView, at: number): bigint => BigInt(data.getUint32(at, true));
const rotated = (x: bigint, n: bigint): bigint => ((x << n) | (x >> (64n - n))) & MASK;

function folded(a: bigint, b: bigint): bigint {
  const product = a * b;
  return (product & MASK) ^ (product >> 64n);
}

function avalanche(h: bigint): bigint {
  h = ((h ^ (h >> 37n)) * MIX_1) & MASK;
  return h ^ (h >> 32n);
}

function avalanche64(h: bigint): bigint {
  h = ((h ^ (h >> 33n)) * P64_2) & MASK;
  h = ((h ^ (h >> 29n)) * P64_3) & MASK;
  return h ^ (h >> 32n);
}

function swapped(x: bigint): bigint {
  const bytes = new DataView(new ArrayBuffer(8));
  bytes.setBigUint64(0, x, true);
  return bytes.getBigUint64(0, false);
}

function secretView(): DataView {
  return view(Uint8Array.from({ length: 192 }, (_, i) => parseInt(SECRET_DIGITS.slice(2 * i, 2 * i + 2), 16)));
}

function upTo16(input: DataView, secret: DataView): bigint {
  const length = input.byteLength;
  if (length === 0) return avalanche64(r64(secret, 56) ^ r64(secret, 64));
  if (length <= 3) {
    const [first, middle, last] = [input.getUint8(0), input.getUint8(length >> 1), input.getUint8(length - 1)];
    const combined = (BigInt(first) << 16n) | (BigInt(middle) << 24n) | BigInt(last) | (BigInt(length) << 8n);
    return avalanche64(combined ^ (r32(secret, 0) ^ r32(secret, 4)));
  }
  if (length <= 8) {
    let h = (r32(input, length - 4) + (r32(input, 0) << 32n)) ^ r64(secret, 8) ^ r64(secret, 16);
    h = ((h ^ rotated(h, 49n) ^ rotated(h, 24n)) * MIX_2) & MASK;
    h = ((h ^ ((h >> 35n) + BigInt(length))) * MIX_2) & MASK;
    return h ^ (h >> 28n);
  }
  const low = r64(input, 0) ^ r64(secret, 24) ^ r64(secret, 32);
  const high = r64(input, length - 8) ^ r64(secret, 40) ^ r64(secret, 48);
  return avalanche((BigInt(length) + swapped(low) + high + folded(low, high)) & MASK);
}

function upTo240(input: DataView, secret: DataView): bigint {
  const length = input.byteLength;
  const mixed = (at: number, s: number): bigint => folded(r64(input, at) ^ r64(secret, s), r64(input, at + 8) ^ r64(secret, s + 8));
  let sum = (BigInt(length) * P64_1) & MASK;
  if (length <= 128) {
    for (let i = Math.floor((length - 1) / 32); i >= 0; --i) sum += mixed(16 * i, 32 * i) + mixed(length - 16 * (i + 1), 32 * i + 16);
    return avalanche(sum & MASK);
  }
  for (let i = 0; i < 8; ++i) sum += mixed(16 * i, 16 * i);
  sum = avalanche(sum & MASK);
  for (let i = 8; i < length >> 4; ++i) sum += mixed(16 * i, 16 * (i - 8) + 3);
  return avalanche((sum + mixed(length - 16, 119)) & MASK);
}

function longer(input: DataView, secret: DataView): bigint {
  const length = input.byteLength;
  const lanes = [P32_3, P64_1, P64_2, P64_3, P64_4, P32_2, P64_5, P32_1];
  const keys = Array.from({ length: 185 }, (_, at) => r64(secret, at));
  const accumulate = (at: number, s: number): void => {
    for (let i = 0; i < 8; ++i) {
      const value = r64(input, at + 8 * i);
      const key = value ^ keys[s + 8 * i]!;
      lanes[i ^ 1] = (lanes[i ^ 1]! + value) & MASK;
      lanes[i] = (lanes[i]! + (key & 0xffffffffn) * (key >> 32n)) & MASK;
    }
  };
  const stripes = Math.floor((length - 1) / STRIPE);
  for (let n = 0; n < stripes; ++n) {
    accumulate(STRIPE * n, 8 * (n % STRIPES_PER_BLOCK));
    if (n % STRIPES_PER_BLOCK !== STRIPES_PER_BLOCK - 1) continue;
    for (let i = 0; i < 8; ++i) lanes[i] = ((lanes[i]! ^ (lanes[i]! >> 47n) ^ keys[128 + 8 * i]!) * P32_1) & MASK;
  }
  accumulate(length - STRIPE, 121);
  let sum = (BigInt(length) * P64_1) & MASK;
  for (let i = 0; i < 4; ++i) sum += folded(lanes[2 * i]! ^ keys[11 + 16 * i]!, lanes[2 * i + 1]! ^ keys[19 + 16 * i]!);
  return avalanche(sum & MASK);
}

export function xxh3(bytes: Uint8Array): bigint {
  const [input, secret] = [view(bytes), secretView()];
  if (bytes.length <= 16) return upTo16(input, secret);
  return bytes.length <= 240 ? upTo240(input, secret) : longer(input, secret);
}
