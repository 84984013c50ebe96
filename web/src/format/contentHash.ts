import type { Hash256 } from "@schema/cell_generated";

import { corrupt } from "./error";
import { sha256 } from "./sha256";

/** 64 lower-case hexadecimal digits. */
export function hashText(hash: Hash256): string {
  const bytes = new Uint8Array(32);
  const view = new DataView(bytes.buffer);
  [hash.word0(), hash.word1(), hash.word2(), hash.word3()].forEach((word, i) => view.setBigUint64(8 * i, word, true));
  return hexText(bytes);
}

export function hexText(bytes: Uint8Array): string {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Throws FormatError unless the file's SHA-256, with its own 32 bytes set to zero, is the one that it states.
 * Returns it as text.
 */
export async function checkContentHash(file: Uint8Array, hash: Hash256, what: string): Promise<string> {
  const stated = hashText(hash);
  const blanked = file.slice();
  blanked.fill(0, hash.bb_pos, hash.bb_pos + 32);
  const found = hexText(await sha256(blanked));
  if (found !== stated) corrupt(`The ${what} is damaged: it says that it is ${stated.slice(0, 12)} but is ${found.slice(0, 12)}.`);
  return stated;
}
