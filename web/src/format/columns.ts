import { corrupt } from "./error";

// FORMAT.md, "Columns": integers as what a straight line does not foretell, lowest bytes first.

const MASK = (1n << 64n) - 1n;

/** The `count` integers, modulo 2^64 and read as signed. */
export function readColumn(bytes: Uint8Array, count: number, what: string): bigint[] {
  if (count === 0 ? bytes.length !== 0 : bytes.length % count !== 0 || bytes.length > 8 * count) {
    corrupt(`${what}: ${bytes.length} bytes are no column of ${count} numbers.`);
  }
  const width = count === 0 ? 0 : bytes.length / count;
  const values: bigint[] = [];
  let last = 0n;
  let step = 0n;
  for (let i = 0; i < count; ++i) {
    let u = 0n;
    for (let k = width - 1; k >= 0; --k) u = (u << 8n) | BigInt(bytes[k * count + i]!);
    const r = (u & 1n) === 0n ? u >> 1n : ~(u >> 1n); // 0, -1, 1, -2, ...
    // r_0 = v_0 and r_1 = v_1 - v_0: the first number has no step behind it.
    const value = (i === 0 ? r : last + step + r) & MASK;
    step = i === 0 ? 0n : (value - last) & MASK;
    last = value;
    values.push(BigInt.asIntN(64, value));
  }
  return values;
}
