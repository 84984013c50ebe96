import { Matrix4, Vector3 } from "three";
import { expect, test } from "vitest";

import { bestFit, distances, errors, readTrajectory, rms, type Trajectory } from "../src/model/trajectory";

/** A helix, so that it has a shape in every direction. */
function helix(n: number, motion = new Matrix4()): Trajectory {
  const positions = new Float64Array(3 * n);
  for (let i = 0; i < n; ++i) new Vector3(9 * Math.cos(i / 5), 5 * Math.sin(i / 5), i / 7).applyMatrix4(motion).toArray(positions as unknown as number[], 3 * i);
  return { stamps: new Float64Array(), positions };
}

test.each([0.1, 1.5, 3.1])("the best fit undoes any motion, a turn of %f too", (angle) => {
  const motion = new Matrix4().makeRotationAxis(new Vector3(1, 2, -0.5).normalize(), angle).setPosition(30, -4, 2);
  const [there, here] = [helix(80, motion), helix(80)];
  expect(rms(errors(here, there, bestFit(here, there)))).toBeLessThan(1e-9);
});

test("the best fit beats the motion that noise was added to", () => {
  const motion = new Matrix4().makeRotationZ(0.7).setPosition(1, 2, 3);
  const [here, there] = [helix(80), helix(80, motion)];
  there.positions.forEach((_, i) => (there.positions[i]! += Math.sin(7 * i)));
  expect(rms(errors(here, there, bestFit(here, there)))).toBeLessThanOrEqual(rms(errors(here, there, motion)));
});

test("both forms of trajectory files say the same positions", () => {
  const tum = readTrajectory("# stamp x y z q\n0.5 1 2 3 0 0 0 1\n0.6 4 5 6 0 0 0 1\n");
  const kitti = readTrajectory("1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 4 0 1 0 5 0 0 1 6\n");
  expect(Array.from(tum.positions)).toEqual([1, 2, 3, 4, 5, 6]);
  expect(kitti.positions).toEqual(tum.positions);
  expect(Array.from(tum.stamps)).toEqual([0.5, 0.6]);
  expect(distances(tum)[1]).toBeCloseTo(Math.sqrt(27));
});

test.each(["", "1 2 3", "a b c d e f g h", "1 2 3 4 5 6 7 8\n1 2 3 4 5 6 7"])("%j is no trajectory", (text) => {
  expect(() => readTrajectory(text)).toThrow(/TUM/);
});
