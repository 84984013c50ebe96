import { expect, test } from "vitest";

import { chooseDetail } from "../../src/scene/detail";

const street = (cells: number): { id: number; distance: number; planes: number }[] =>
  Array.from({ length: cells }, (_, id) => ({ id, distance: 6 * id, planes: 5000 }));

const cost = (levels: Map<number, number>): number => [...levels.values()].reduce((sum, level) => sum + 5000 / 2 ** level, 0);

test("a small map is drawn whole", () => {
  expect([...chooseDetail(street(20), 1e6).values()]).toEqual(new Array(20).fill(0));
});

test.each([30_000, 200_000, 2_000_000])("a map of 577 CELLs stays within %i patches, nearer ones never coarser", (budget) => {
  const levels = chooseDetail(street(577), budget);
  expect(cost(levels)).toBeLessThanOrEqual(budget);
  for (let id = 1; id < 577; ++id) expect(levels.get(id)!).toBeGreaterThanOrEqual(levels.get(id - 1)!);
});

test("of a map that is too large even at its coarsest the nearest CELLs are drawn", () => {
  const levels = chooseDetail(street(10_000), 20_000);
  expect(levels.size).toBeGreaterThan(100);
  expect(cost(levels)).toBeLessThanOrEqual(20_000);
  expect(levels.has(0)).toBe(true);
  expect(levels.has(9999)).toBe(false);
});
