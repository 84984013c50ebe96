import { LEVELS } from "./patchLayout";

/** A CELL as the choice of detail sees it. */
export interface Candidate {
  id: number;
  /** From the camera to the CELL, metres. */
  distance: number;
  planes: number;
}

/** Metres of a CELL's surroundings that count as near it. */
const REACH_M = 15;

/**
 * The level of detail of each CELL (level k has 2^-k of its patches) such that all together are within `budget` patches:
 * what is twice as far gets a quarter. CELLs for which nothing is left are not in the answer.
 */
export function chooseDetail(candidates: Candidate[], budget: number): Map<number, number> {
  const nearestFirst = [...candidates].sort((a, b) => a.distance - b.distance);
  for (let full = 160; full > 1; full *= 0.8) {
    const levels = levelsFor(nearestFirst, full);
    if (cost(nearestFirst, levels) <= budget) return levels;
  }
  const levels = new Map<number, number>();
  let left = budget;
  for (const { id, planes } of nearestFirst) {
    left -= planes / 2 ** (LEVELS - 1);
    if (left < 0) break;
    levels.set(id, LEVELS - 1);
  }
  return levels;
}

/** All patches within `full` metres, a quarter at twice that. */
function levelsFor(candidates: Candidate[], full: number): Map<number, number> {
  return new Map(
    candidates.map(({ id, distance }) => {
      const ratio = Math.max(1, (distance - REACH_M) / full);
      return [id, Math.min(LEVELS - 1, Math.round(2 * Math.log2(ratio)))];
    }),
  );
}

function cost(candidates: Candidate[], levels: Map<number, number>): number {
  return candidates.reduce((sum, { id, planes }) => sum + planes / 2 ** levels.get(id)!, 0);
}
