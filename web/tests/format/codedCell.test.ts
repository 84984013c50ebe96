import { readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, test } from "vitest";

import { readCoarseCell, readCodedCell } from "../../src/format/codedCell";
import { FormatError } from "../../src/format/error";
import { firstProbabilities } from "../../src/format/firstProbabilities";
import { Lattices } from "../../src/format/lattice";
import { hashOf, type Json, poseOf, twin, vectorBytes } from "./vectors";

const lattices = new Lattices();
const names = ["room-packed", "room-10mm", "part-of-a-room-20mm", "bands-50mm", "bands-packed", "nothing-packed", "nothing-1mm",
  "room-10mm-2", "part-of-a-room-20mm-2", "bands-50mm-2", "nothing-1mm-2"];

test.each(names.flatMap((name) => [[name, ""], [name, ".canonical"]]))("%s%s.ccod has the content of its twin", async (name, layout) => {
  const json = twin(`${name}.json`);
  const cell = await readCodedCell(vectorBytes(`${name}${layout}.ccod`), lattices);
  expect(Array.from(cell.indices)).toEqual(json.decoded.indices);
  const planes = (json.decoded.planes ?? json.decoded.source).flatMap((p: Json) => [p.distance, p.nx, p.ny, p.nz].map(Math.fround));
  expect(Array.from(cell.planes)).toEqual(planes);
  expect(cell.coarsePlanes).toBe(json.decoded.coarse_indices.length);
  expect(cell.rawHash).toBe(hashOf(json.raw_hash));
  expect(cell.session).toBe(json.session);
  expect(Array.from(cell.T_odom_cell)).toEqual(poseOf(json.t_odom_cell));
});

test.each(names)("the beginning of %s is a CELL of a quarter of the planes, each as in the whole", async (name) => {
  const json = twin(`${name}.json`);
  const whole = vectorBytes(`${name}.canonical.ccod`);
  const data = json.data as number[];
  const end = data.length === 0 ? whole.length : whole.length - (data.length - json.coarse_bytes);
  const padding = data.length === 0 ? 0 : Array.from({ length: 8 }, (_, i) => i).find((i) => data.at(-1) === whole.at(-1 - i) && matches(whole, data, i))!;
  const beginning = whole.slice(0, end - padding);
  const cell = await readCoarseCell(beginning, whole.length, lattices);
  expect(Array.from(cell.indices)).toEqual(json.decoded.coarse_indices);
  const all = await readCodedCell(whole, lattices);
  const rows = Array.from(all.indices, (index, k) => (json.decoded.coarse_indices.includes(index) ? k : -1)).filter((k) => k >= 0);
  expect(Array.from(cell.planes)).toEqual(rows.flatMap((k) => Array.from(all.planes.subarray(4 * k, 4 * k + 4))));
  if (json.coarse_bytes > 0) await expect(readCoarseCell(beginning.slice(0, -1), whole.length, lattices)).rejects.toThrow(FormatError);
});

const matches = (file: Uint8Array, data: number[], padding: number): boolean =>
  data.every((byte, i) => file[file.length - padding - data.length + i] === byte);

test("first probabilities are those of the document", () => {
  const text = readFileSync(join(process.env.CELLMAP_SOURCE_DIR ?? "..", "schema/FORMAT.md"), "utf8");
  const section = text.slice(text.indexOf("### First probabilities"), text.indexOf("### Packed planes"));
  const digits = section.match(/^ {4}[0-9a-f]+$/gm)!.map((line) => line.trim()).join("");
  const tables = ([1, 2] as const).flatMap((version) => [0, 1].map((layer) => firstProbabilities(version, layer)));
  expect(tables.map((table) => Buffer.from(table).toString("hex")).join("")).toBe(digits);
});

test.each(["room-packed", "room-10mm", "room-10mm-2"])("%s with a bit flipped anywhere is refused as such", async (name) => {
  const bytes = vectorBytes(`${name}.ccod`);
  for (let i = 0; i < bytes.length; i += 7) {
    const flipped = bytes.slice();
    flipped[i]! ^= 1 << (i % 8);
    await expect(readCodedCell(flipped, lattices), `byte ${i}`).rejects.toThrow(FormatError);
  }
});
