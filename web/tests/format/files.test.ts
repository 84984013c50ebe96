import { execFileSync } from "node:child_process";
import { expect, test } from "vitest";

import { readBatch } from "../../src/format/batch";
import { FormatError } from "../../src/format/error";
import { readScan } from "../../src/format/scan";
import { zstdDecompress } from "../../src/format/zstd";
import { big, poseOf, twin, vectorBytes } from "./vectors";

test.each(["with-nan", "no-points"])("%s.cscn has the content of its twin", (name) => {
  const json = twin(`${name}.json`);
  for (const layout of ["", ".canonical"]) {
    const scan = readScan(vectorBytes(`${name}${layout}.cscn`));
    expect(scan.index).toBe(big(json.index));
    expect(scan.stampNs).toBe(big(json.stamp_ns));
    expect(Array.from(scan.T_odom_sensor)).toEqual(poseOf(json.t_odom_sensor));
    const numbers = (column: (number | string)[]): number[] =>
      column.map((x) => ({ nan: NaN, inf: Infinity, "-inf": -Infinity })[x as string] ?? Number(x));
    for (const axis of ["x", "y", "z"] as const) expect(Array.from(scan[axis])).toEqual(numbers(json[axis]));
  }
});

test("a batch is its entries; one that ends inside an entry is refused", () => {
  const cell = vectorBytes("empty.cell");
  const batch = new Uint8Array(2 * (8 + cell.length));
  const view = new DataView(batch.buffer);
  [7, 4_000_000_000].forEach((id, i) => {
    const at = i * (8 + cell.length);
    view.setUint32(at, id, true);
    view.setUint32(at + 4, cell.length, true);
    batch.set(cell, at + 8);
  });
  expect(readBatch(batch).map((entry) => entry.cell)).toEqual([7, 4_000_000_000]);
  expect(readBatch(batch)[1]!.bytes).toEqual(cell);
  expect(readBatch(new Uint8Array())).toEqual([]);
  for (let length = 1; length < batch.length; ++length) {
    if (length === 8 + cell.length) continue;
    expect(() => readBatch(batch.subarray(0, length))).toThrow(FormatError);
  }
});

/** A zstd frame by the command; null where there is none. */
function zstdFrame(content: Uint8Array): Uint8Array | null {
  try {
    return new Uint8Array(execFileSync("zstd", ["-q", "-19", `--stream-size=${content.length}`], { input: content }));
  } catch {
    return null;
  }
}

const content = Uint8Array.from({ length: 5000 }, (_, i) => (i * i) % 251);

test("a zstd frame is exactly one, declares its size and stays below the limit", ({ skip }) => {
  const frame = zstdFrame(content) ?? skip("there is no zstd command");
  expect(zstdDecompress(frame, 5000)).toEqual(content);
  expect(() => zstdDecompress(frame, 4999)).toThrow(expect.objectContaining({ code: "too-large" }));
  expect(() => zstdDecompress(Uint8Array.of(...frame, 0), 5000)).toThrow(FormatError);
  for (let length = 0; length < frame.length; ++length) {
    expect(() => zstdDecompress(frame.subarray(0, length), 5000), `${length} bytes`).toThrow(FormatError);
  }
});

test("a zstd frame that was tampered with never gives another size", ({ skip }) => {
  const frame = zstdFrame(content) ?? skip("there is no zstd command");
  for (let i = 0; i < frame.length; ++i) {
    const flipped = frame.slice();
    flipped[i]! ^= 1 << (i % 8);
    try {
      expect(zstdDecompress(flipped, 5000).length).toBeLessThanOrEqual(5000);
    } catch (error) {
      expect(error, `byte ${i}`).toBeInstanceOf(FormatError);
    }
  }
});
