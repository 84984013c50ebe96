import { createHash } from "node:crypto";
import { describe, expect, test } from "vitest";

import { type Cell, readCell } from "../../src/format/cell";
import { FormatError } from "../../src/format/error";
import { Lattices } from "../../src/format/lattice";
import { sha256InScript } from "../../src/format/sha256";
import { big, hashOf, type Json, poseOf, twin, vectorBytes } from "./vectors";

const lattices = new Lattices();
const names = ["street", "empty", "largest-lattice", "released-lattice"];

function expectTwin(cell: Cell, json: Json): void {
  const kind = json.lattice.kind === "FibonacciBands" ? "fibonacci-bands" : "fibonacci";
  expect(cell.lattice).toEqual({ kind, size: json.lattice.size });
  expect(Array.from(cell.indices)).toEqual(json.indices);
  const planes = json.planes.flatMap((p: Json) => [p.distance, p.nx, p.ny, p.nz].map(Math.fround));
  expect(Array.from(cell.planes)).toEqual(planes);
  expect(cell.session).toBe(json.session);
  expect(cell.sequence).toBe(json.sequence ?? 0);
  expect(Array.from(cell.T_odom_cell)).toEqual(poseOf(json.t_odom_cell));
  expect(cell.firstStampNs).toBe(big(json.first_stamp_ns));
  expect(cell.lastStampNs).toBe(big(json.last_stamp_ns));
  expect(cell.firstScan).toBe(json.first_scan ?? 0);
  expect(cell.scanCount).toBe(json.scan_count ?? 0);
  expect(cell.statistics.points).toBe(big(json.statistics?.points));
  expect(cell.statistics.pointsInPlanes).toBe(big(json.statistics?.points_in_planes));
  expect(cell.statistics.patchesHit).toBe(json.statistics?.patches_hit ?? 0);
  expect(cell.statistics.rejectedGrazing).toBe(json.statistics?.rejected_grazing ?? 0);
}

describe.each(names)("%s", (name) => {
  test("has the content of its twin", async () => {
    const json = twin(`${name}.json`);
    const cell = await readCell(vectorBytes(`${name}.cell`), lattices);
    expectTwin(cell, json);
    expect(cell.hash).toBe(hashOf(json.content_hash));
  });

  test("has the same content in the library's layout", async () => {
    expectTwin(await readCell(vectorBytes(`${name}.canonical.cell`), lattices), twin(`${name}.json`));
  });
});

test("a CELL cut anywhere is refused as such", async () => {
  const bytes = vectorBytes("street.cell");
  for (let length = 0; length < bytes.length; length += 3) {
    await expect(readCell(bytes.subarray(0, length), lattices)).rejects.toThrow(FormatError);
  }
});

test("a CELL with any bit flipped is refused as such", async () => {
  const bytes = vectorBytes("street.cell");
  for (let i = 0; i < bytes.length; ++i) {
    const flipped = bytes.slice();
    flipped[i]! ^= 1 << (i % 8);
    await expect(readCell(flipped, lattices), `byte ${i}`).rejects.toThrow(FormatError);
  }
});

test("another version is unsupported, not corrupt", async () => {
  const bytes = vectorBytes("street.canonical.cell");
  const view = new DataView(bytes.buffer);
  const root = view.getUint32(0, true);
  const vtable = root - view.getInt32(root, true);
  view.setUint16(root + view.getUint16(vtable + 4, true), 2, true);
  await expect(readCell(bytes, lattices)).rejects.toMatchObject({ code: "unsupported" });
});

test("SHA-256 without WebCrypto agrees with the library of Node.js", () => {
  for (const length of [0, 1, 55, 56, 63, 64, 65, 1000]) {
    const bytes = Uint8Array.from({ length }, (_, i) => (i * 37) & 255);
    expect(Buffer.from(sha256InScript(bytes)).toString("hex")).toBe(createHash("sha256").update(bytes).digest("hex"));
  }
});
