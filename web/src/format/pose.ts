import type { Pose as WirePose } from "@schema/cell_generated";

import { corrupt } from "./error";

/** A rigid transform: the row-major 3x4 matrix [R | t], metres. */
export type Pose = Float64Array;

/** The pose as it was sent; throws FormatError where it is no rigid transform. */
export function readPose(p: WirePose, what: string): Pose {
  const pose = Float64Array.of(
    p.r00(), p.r01(), p.r02(), p.tx(), //
    p.r10(), p.r11(), p.r12(), p.ty(), //
    p.r20(), p.r21(), p.r22(), p.tz(),
  );
  checkPose(pose, what);
  return pose;
}

export function checkPose(pose: Pose, what: string): void {
  if (!pose.every(Number.isFinite)) corrupt(`${what} has a number that is not finite.`);
  let error = 0;
  for (let i = 0; i < 3; ++i) {
    for (let j = 0; j < 3; ++j) {
      const dot = pose[4 * i]! * pose[4 * j]! + pose[4 * i + 1]! * pose[4 * j + 1]! + pose[4 * i + 2]! * pose[4 * j + 2]!;
      error += (dot - (i === j ? 1 : 0)) ** 2;
    }
  }
  if (!(Math.sqrt(error) < 1e-6) || !(determinant(pose) > 0)) corrupt(`${what} is no rigid transform.`);
}

function determinant(p: Pose): number {
  return (
    p[0]! * (p[5]! * p[10]! - p[6]! * p[9]!) -
    p[1]! * (p[4]! * p[10]! - p[6]! * p[8]!) +
    p[2]! * (p[4]! * p[9]! - p[5]! * p[8]!)
  );
}
