import { readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, test } from "vitest";

import { readCodedCell } from "../../src/format/codedCell";
import { FormatError } from "../../src/format/error";
import { FIRST_PROBABILITIES } from "../../src/format/firstProbabilities";
import { Lattices } from "../../src/format/lattice";
import { hashOf, type Json, poseOf, twin, vectorBytes } from "./vectors";

const lattices = new Lattices();
const names = ["room-packed", "room-10mm", "part-of-a-room-20mm", "bands-50mm", "bands-packed", "nothing-packed", "nothing-1mm"];

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

test("first probabilities are those of the document", () => {
  const text = readFileSync(join(process.env.CELLMAP_SOURCE_DIR ?? "..", "schema/FORMAT.md"), "utf8");
  const section = text.slice(text.indexOf("### First probabilities"), text.indexOf("### Packed planes"));
  expect(FIRST_PROBABILITIES).toBe(section.match(/^ {4}[0-9a-f]+$/gm)!.map((line) => line.trim()).join(""));
});

test.each(["room-packed", "room-10mm"])("%s with a bit flipped anywhere is refused as such", async (name) => {
  const bytes = vectorBytes(`${name}.ccod`);
  for (let i = 0; i < bytes.length; i += 7) {
    const flipped = bytes.slice();
    flipped[i]! ^= 1 << (i % 8);
    await expect(readCodedCell(flipped, lattices), `byte ${i}`).rejects.toThrow(FormatError);
  }
});
