import { expect, test } from "vitest";

import { ticks } from "../src/plot";
import type { ComparisonRow } from "../src/api/documents";
import { familyOf, frontier } from "../src/panels/comparePanel";

test("ticks are round and within the axis", () => {
  expect(ticks({ low: 0, high: 47 })).toEqual([0, 10, 20, 30, 40]);
  expect(ticks({ low: -3, high: 3 })).toEqual([-3, -2, -1, 0, 1, 2, 3]);
  expect(ticks({ low: 400, high: 30_000, log: true })).toEqual([500, 1000, 2000, 5000, 10_000, 20_000]);
  expect(ticks({ low: 1, high: 1e6, log: true }).length).toBe(7);
});

test("the frontier has what no other beats in size and error", () => {
  const row = (name: string, bytes_per_m: number, registration_error_m: number): never => ({ name, bytes_per_m, registration_error_m }) as never;
  const rows = [row("large and good", 100, 1), row("beaten", 60, 5), row("small", 10, 4), row("as small, worse", 10, 6), row("medium", 50, 2)];
  expect(frontier(rows).map(({ name }: ComparisonRow) => name)).toEqual(["small", "medium", "large and good"]);
});

test("rows of the comparison are known by their kind", () => {
  expect(["CELLs, compact, 20 mm", "0.4 m voxels, Draco", "raw points", "surfels, 0.4 m", "mesh (Poisson)", "neural field"].map(familyOf)).toEqual([
    "cells", "clouds", "clouds", "surfels", "mesh", "other",
  ]);
});
