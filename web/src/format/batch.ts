import { corrupt } from "./error";

/** A CELL's bytes in a batch of CELLs, with its id in the map. The bytes are part of the batch's. */
export interface BatchEntry {
  cell: number;
  bytes: Uint8Array;
}

/** The entries of a batch of CELLs (FORMAT.md). Throws FormatError for one that ends inside an entry. */
export function readBatch(bytes: Uint8Array): BatchEntry[] {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const entries: BatchEntry[] = [];
  let at = 0;
  while (at < bytes.length) {
    const left = bytes.length - at - 8;
    if (left < 0 || view.getUint32(at + 4, true) > left) corrupt("The batch of CELLs ends inside an entry.");
    const length = view.getUint32(at + 4, true);
    entries.push({ cell: view.getUint32(at, true), bytes: bytes.subarray(at + 8, at + 8 + length) });
    at += 8 + length;
  }
  return entries;
}
