import { expect, test } from "vitest";

import { FormatError } from "../../src/format/error";
import { latticeId, Lattices } from "../../src/format/lattice";
import { twin } from "./vectors";

const lattices = new Lattices();

test.each(["lattice-directions.json", "band-directions.json"])("%s: directions agree to the last bit", (name) => {
  for (const { kind, size, count, index, direction } of twin(name)) {
    const lattice = lattices.get({ kind, size });
    if (count !== undefined) expect(lattice.count).toBe(count);
    const found = Array.from(lattice.directions.subarray(3 * index, 3 * index + 3));
    found.forEach((x, axis) => expect(x, `${kind} ${size} point ${index}`).toBe(direction[axis]));
  }
});

test("directions are those of the definition within 1e-12", () => {
  const phi = (1 + Math.sqrt(5)) / 2;
  const { directions } = lattices.get({ kind: "fibonacci", size: 5000 });
  for (let i = 0; i < 5000; ++i) {
    const z = (5000 - 2 * i - 1) / 5000;
    const azimuth = 2 * Math.PI * ((i / phi) % 1);
    expect(Math.abs(directions[3 * i]! - Math.sqrt(1 - z * z) * Math.cos(azimuth))).toBeLessThan(1e-11);
    expect(Math.abs(directions[3 * i + 1]! - Math.sqrt(1 - z * z) * Math.sin(azimuth))).toBeLessThan(1e-11);
    expect(Math.abs(directions[3 * i + 2]! - z)).toBeLessThan(1e-12);
  }
});

test("the released lattice has the 42,563 directions of the paper's code", () => {
  expect(lattices.get({ kind: "fibonacci-bands", size: 50_000 }).count).toBe(42_563);
});

test.each([
  [0, 1, 50_000],
  [3, 1, 50_000],
  [1, 2, 50_000],
  [1, 1, 999],
  [1, 1, 1_000_001],
  [2, 1, 500_001],
])("kind %i, version %i, size %i is refused", (kind, version, size) => {
  expect(() => latticeId(kind, version, size)).toThrow(FormatError);
});
