import { Matrix4, Quaternion, Vector3 } from "three";

import type { PoseArray } from "../api/documents";
import type { Pose } from "../format/pose";

export function matrixOfPose(p: Pose): Matrix4 {
  return new Matrix4().set(
    p[0]!, p[1]!, p[2]!, p[3]!, //
    p[4]!, p[5]!, p[6]!, p[7]!, //
    p[8]!, p[9]!, p[10]!, p[11]!, //
    0, 0, 0, 1,
  );
}

export function matrixOfArray([x, y, z, qx, qy, qz, qw]: PoseArray): Matrix4 {
  return new Matrix4().compose(new Vector3(x, y, z), new Quaternion(qx, qy, qz, qw).normalize(), new Vector3(1, 1, 1));
}

/** Heading counter-clockwise from the map's x, degrees. */
export function yawDeg(matrix: Matrix4): number {
  return (Math.atan2(matrix.elements[1]!, matrix.elements[0]!) * 180) / Math.PI;
}

export function positionOf(matrix: Matrix4): Vector3 {
  return new Vector3().setFromMatrixPosition(matrix);
}

/** Between two rigid transforms: t = 0 is a, 1 is b. */
export function interpolated(a: Matrix4, b: Matrix4, t: number): Matrix4 {
  const [pa, pb, one] = [new Vector3(), new Vector3(), new Vector3()];
  const [qa, qb] = [new Quaternion(), new Quaternion()];
  a.decompose(pa, qa, one);
  b.decompose(pb, qb, one);
  return new Matrix4().compose(pa.lerp(pb, t), qa.slerp(qb, t), one.set(1, 1, 1));
}
