import { readFileSync } from "node:fs";
import { join } from "node:path";

const folder = join(process.env.CELLMAP_SOURCE_DIR ?? "..", "tests/conformance/v1");

export function vectorBytes(name: string): Uint8Array {
  return new Uint8Array(readFileSync(join(folder, name)));
}

// eslint-disable-next-line @typescript-eslint/no-explicit-any
export type Json = any;

/** A JSON twin; integers beyond 2^53 become bigint. */
export function twin(name: string): Json {
  const text = readFileSync(join(folder, name), "utf8").replace(/(?<![\d."\w])(-?\d{16,})(?![\d.e])/g, '"#$1"');
  return JSON.parse(text, (_key, value: unknown) =>
    typeof value === "string" && value.startsWith("#") ? BigInt(value.slice(1)) : value,
  );
}

export const POSE_NAMES = ["r00", "r01", "r02", "tx", "r10", "r11", "r12", "ty", "r20", "r21", "r22", "tz"];

export function poseOf(json: Record<string, number>): number[] {
  return POSE_NAMES.map((name) => json[name]!);
}

export const big = (value: number | bigint | undefined): bigint => BigInt(value ?? 0);

/** The four words as the 64 digits of the digest. */
export function hashOf(json: Record<string, number | bigint>): string {
  const view = new DataView(new ArrayBuffer(32));
  for (let i = 0; i < 4; ++i) view.setBigUint64(8 * i, big(json[`word${i}`]), true);
  return Buffer.from(view.buffer).toString("hex");
}
