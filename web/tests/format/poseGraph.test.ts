import { expect, test } from "vitest";

import { FormatError } from "../../src/format/error";
import { readPoseGraph } from "../../src/format/poseGraph";
import { big, type Json, poseOf, twin, vectorBytes } from "./vectors";

test.each([
  ["three-cells", ""],
  ["three-cells", ".canonical"],
  ["judged-loops", ""],
  ["judged-loops", ".canonical"],
  ["empty-map", ""],
  ["empty-map", ".canonical"],
])("%s%s.cpgr has the content of its twin", (name, layout) => {
  const json = twin(`${name}.json`);
  const graph = readPoseGraph(vectorBytes(`${name}${layout}.cpgr`));
  expect(graph.revision).toBe(big(json.revision));
  expect(Array.from(graph.cells)).toEqual(json.nodes.map((node: Json) => node.cell));
  expect(graph.poses.map((pose) => Array.from(pose))).toEqual(json.nodes.map((node: Json) => poseOf(node.t_map_cell)));
  expect(Array.from(graph.unaligned)).toEqual(json.unaligned ?? []);
  expect(graph.constraints.length).toBe(json.constraints.length);
  graph.constraints.forEach((constraint, i) => {
    const expected = json.constraints[i];
    expect(constraint.id).toBe(expected.id ?? 0);
    expect([constraint.from, constraint.to]).toEqual([expected.from ?? 0, expected.to ?? 0]);
    expect(constraint.kind).toBe(expected.kind.toLowerCase());
    expect(constraint.origin).toBe(expected.origin.toLowerCase());
    expect(Array.from(constraint.T_from_to)).toEqual(poseOf(expected.t_from_to));
    expect(Array.from(constraint.information)).toEqual(Object.values(expected.information));
    expect(constraint.scores.points).toBe(expected.scores?.points ?? 0);
    expect(constraint.scores.inlierRatioHit).toBe(expected.scores?.inlier_ratio_hit ?? 0);
    expect(constraint.scores.medianResidualM).toBe(expected.scores?.median_residual_m ?? 0);
    expect(constraint.weight).toBe(expected.weight ?? 1);
    expect(constraint.pinned).toBe(expected.pinned ?? false);
  });
});

test("a pose graph cut anywhere is refused as such", () => {
  const bytes = vectorBytes("judged-loops.cpgr");
  for (let length = 0; length < bytes.length; length += 3) {
    expect(() => readPoseGraph(bytes.subarray(0, length)), `${length} bytes`).toThrow(FormatError);
  }
});

test("a pose graph with a bit flipped anywhere is read or refused, never followed out of its bytes", () => {
  const bytes = vectorBytes("judged-loops.cpgr");
  for (let i = 0; i < 8 * bytes.length; i += 5) {
    const flipped = bytes.slice();
    flipped[i >> 3]! ^= 1 << (i & 7);
    try {
      readPoseGraph(flipped);
    } catch (error) {
      expect(error, `bit ${i}`).toBeInstanceOf(FormatError);
    }
  }
});
