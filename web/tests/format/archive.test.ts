import { expect, test } from "vitest";

import { Archive } from "../../src/format/archive";
import { BlobSource } from "../../src/format/byteSource";
import { readCell } from "../../src/format/cell";
import { FormatError } from "../../src/format/error";
import { Lattices } from "../../src/format/lattice";
import { big, type Json, poseOf, twin, vectorBytes } from "./vectors";

const lattices = new Lattices();

const open = (bytes: Uint8Array): Promise<Archive> => Archive.open(new BlobSource(new Blob([bytes as BlobPart]), "test"));

test.each(["three-cells", "with-leaves", "updated", "half-updated"])("%s.cellmap has the content of its twin", async (name) => {
  const json = twin(`${name}.cellmap.json`);
  const archive = await open(vectorBytes(`${name}.cellmap`));
  expect(archive.summary.map).toBe(json.map);
  expect(big(archive.summary.revision)).toBe(big(json.revision));
  expect(archive.summary.sessions.map((session) => session.name)).toEqual(json.sessions.map((session: Json) => session.name));
  const keys = ["id", "hash", "session", "sequence", "planes", "bytes"] as const;
  archive.cells.forEach((cell, i) => keys.forEach((key) => expect(cell[key], `${key} of CELL ${cell.id}`).toBe(json.cells[i][key])));
  expect(archive.cells.length).toBe(json.cells.length);
  const poses = new Map([...archive.poseGraph.cells].map((id, i) => [id, archive.poseGraph.poses[i]!]));
  for (const { cell, T_map_cell } of archive.changes?.moved ?? []) poses.set(cell, T_map_cell);
  for (const { id, t_map_cell } of json.cells) expect(Array.from(poses.get(id)!)).toEqual(poseOf(t_map_cell));
  const added = archive.changes?.addedConstraints.length ?? 0;
  const removed = archive.changes?.removedConstraints.length ?? 0;
  expect(archive.poseGraph.constraints.length + added - removed).toBe(json.constraints);
  for (const { id, hash } of archive.cells.slice(0, 5)) expect((await readCell(await archive.cell(id), lattices)).hash).toBe(hash);
});

test("an archive cut off anywhere is refused as such", async () => {
  const bytes = vectorBytes("three-cells.cellmap");
  for (let length = 0; length < bytes.length; length += 97) {
    await expect(open(bytes.subarray(0, length)), `${length} bytes`).rejects.toThrow(FormatError);
  }
});

test("an archive with a bit flipped in what is read is refused; CELLs that are whole are read all the same", async () => {
  const bytes = vectorBytes("updated.cellmap");
  for (let i = 0; i < bytes.length; i += 113) {
    const flipped = bytes.slice();
    flipped[i]! ^= 1 << (i % 8);
    try {
      const archive = await open(flipped);
      for (const { id } of archive.cells) {
        const cell = await archive.cell(id).then((content) => readCell(content, lattices));
        expect(cell.hash).toBe(archive.cells.find((other) => other.id === id)!.hash);
      }
    } catch (error) {
      expect(error, `byte ${i}`).toBeInstanceOf(FormatError);
    }
  }
});
