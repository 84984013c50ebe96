import { expect, test } from "vitest";

import type { Cell } from "../../src/format/cell";
import { Lattices } from "../../src/format/lattice";
import { COARSE_LAYER_LEVEL, layOutPatches, LEVELS } from "../../src/scene/patchLayout";

const lattice = new Lattices().get({ kind: "fibonacci", size: 20_000 });

/** Planes that face the origin 5 m away, in every direction below the horizon. */
function bowl(): Cell {
  const indices = Uint32Array.from({ length: 10_000 }, (_, k) => 10_000 + k);
  const planes = new Float32Array(4 * indices.length);
  indices.forEach((index, k) => {
    planes[4 * k] = 5;
    for (let axis = 0; axis < 3; ++axis) planes[4 * k + 1 + axis] = -lattice.directions[3 * index + axis]!;
  });
  return { indices, planes } as Cell;
}

const patches = layOutPatches(bowl(), lattice);

test("every patch is there once, on its ray", () => {
  const seen = new Set<string>();
  let worst = 0;
  for (let k = 0; k < patches.count; ++k) {
    const [x, y, z, radius] = patches.centers.subarray(4 * k, 4 * k + 4) as unknown as [number, number, number, number];
    worst = Math.max(worst, Math.abs(Math.hypot(x, y, z) - 5), Math.abs(radius - 2 / Math.sqrt(20_000)));
    seen.add(`${x} ${y} ${z}`);
  }
  expect(seen.size).toBe(10_000);
  expect(worst).toBeLessThan(1e-5);
});

test("each level has half of the one before, within a tenth", () => {
  expect(patches.levels[0]).toBe(10_000);
  for (let level = 1; level < LEVELS - 1; ++level) {
    const share = patches.levels[level]! / patches.levels[level - 1]!;
    expect(share).toBeGreaterThan(0.45);
    expect(share).toBeLessThan(0.55);
  }
});

test("a patch knows its lattice point", () => {
  for (let k = 0; k < patches.count; k += 101) {
    const direction = lattice.directions.subarray(3 * patches.indices[k]!, 3 * patches.indices[k]! + 3);
    for (let axis = 0; axis < 3; ++axis) expect(patches.centers[4 * k + axis]).toBeCloseTo(5 * direction[axis]!, 5);
  }
});

test("a coarse layer stands for a CELL of four times as many patches", () => {
  const whole = bowl();
  const quarter = whole.indices.filter((index) => index % 4 === 0);
  const planes = Float32Array.from(quarter).fill(0).length;
  const coarse = layOutPatches({ ...whole, indices: quarter, planes: whole.planes.slice(0, 4 * planes) } as Cell, lattice, true);
  expect(coarse.count).toBe(10_000);
  expect(coarse.levels.slice(0, COARSE_LAYER_LEVEL + 1)).toEqual([2500, 2500, 2500]);
  expect(coarse.levels[COARSE_LAYER_LEVEL + 1]! / 2500).toBeCloseTo(0.5, 1);
});

test("a coarse level is even: each twelfth of the circle has its share", () => {
  const count = patches.levels[4]!;
  const sectors = new Array<number>(12).fill(0);
  for (let k = 0; k < count; ++k) {
    const azimuth = Math.atan2(patches.centers[4 * k + 1]!, patches.centers[4 * k]!) + Math.PI;
    ++sectors[Math.min(11, Math.floor((azimuth / (2 * Math.PI)) * 12))]!;
  }
  for (const n of sectors) expect(Math.abs(n - count / 12)).toBeLessThan(0.25 * (count / 12));
});

test("normals come back from two 16-bit numbers within a thousandth", () => {
  for (let k = 0; k < patches.count; k += 97) {
    let [x, y] = [patches.normals[2 * k]! / 32767, patches.normals[2 * k + 1]! / 32767];
    const z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) [x, y] = [(1 - Math.abs(y)) * Math.sign(x || 1), (1 - Math.abs(x)) * Math.sign(y || 1)];
    const length = Math.hypot(x, y, z);
    expect(x / length).toBeCloseTo(-patches.centers[4 * k]! / 5, 3);
    expect(y / length).toBeCloseTo(-patches.centers[4 * k + 1]! / 5, 3);
    expect(z / length).toBeCloseTo(-patches.centers[4 * k + 2]! / 5, 3);
  }
});
