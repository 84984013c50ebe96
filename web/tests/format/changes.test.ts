import { expect, test } from "vitest";

import { readChanges } from "../../src/format/changes";
import { FormatError } from "../../src/format/error";
import { big, hashOf, type Json, twin, vectorBytes } from "./vectors";

const names = ["after-a-loop", "extremes", "beyond-half-a-turn", "no-changes", "judged-anew"];

test.each(names.flatMap((name) => [[name, ""], [name, ".canonical"]]))("%s%s.cchg has the content of its twin", (name, layout) => {
  const json = twin(`${name}.json`);
  const changes = readChanges(vectorBytes(`${name}${layout}.cchg`));
  expect(changes.since).toBe(big(json.since));
  expect(changes.revision).toBe(big(json.revision));
  expect(changes.added.map((cell) => cell.hash)).toEqual(json.added.map((cell: Json) => hashOf(cell.hash)));
  expect(changes.addedConstraints.map(({ id }) => id)).toEqual(json.added_constraints.map((c: Json) => c.id));
  const decoded = json.decoded ?? {};
  if (decoded.moved) {
    expect(changes.moved.map(({ cell }) => cell)).toEqual(decoded.moved.map((moved: Json) => moved.cell));
    changes.moved.forEach(({ T_map_cell }, i) => {
      expect(Array.from(T_map_cell)).toEqual(decodedPose(decoded.moved[i]));
    });
  } else {
    expect(changes.moved).toEqual([]);
  }
  expect(changes.removed).toEqual(decoded.removed ?? []);
  expect(changes.removedConstraints).toEqual(decoded.removed_constraints ?? []);
  expect(changes.unaligned).toEqual(decoded.unaligned ?? []);
  expect(changes.judged.map(({ weight }) => weight)).toEqual(json.judged?.weight ?? []);
  expect(changes.judged.map(({ pinned }) => pinned)).toEqual((json.judged?.pinned ?? []).map(Boolean));
});

function decodedPose(moved: Json): number[] {
  const pose = moved.t_map_cell ?? moved.T_map_cell ?? moved.pose;
  return Array.isArray(pose) ? pose.flat() : Object.values(pose);
}

test("changes with a bit flipped anywhere are read or refused", () => {
  for (const name of ["judged-anew.cchg", "beyond-half-a-turn.cchg"]) {
    const bytes = vectorBytes(name);
    for (let i = 0; i < 8 * bytes.length; i += 5) {
      const flipped = bytes.slice();
      flipped[i >> 3]! ^= 1 << (i & 7);
      try {
        readChanges(flipped);
      } catch (error) {
        expect(error, `bit ${i} of ${name}`).toBeInstanceOf(FormatError);
      }
    }
  }
});
