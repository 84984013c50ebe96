import { Scan as WireScan } from "@schema/scan_generated";

import { POSE } from "./cell";
import { corrupt, tooLarge } from "./error";
import { number, type FileShape, vector, verifiedBuffer } from "./flatbuffer";
import { type Pose, readPose } from "./pose";

/** A sweep (FORMAT.md, "Scan"). Coordinates may be NaN or infinite. */
export interface Scan {
  index: bigint;
  stampNs: bigint;
  T_odom_sensor: Pose;
  x: Float32Array;
  y: Float32Array;
  z: Float32Array;
}

const MAX_POINTS = 2_000_000;
const SCAN: FileShape = {
  name: "scan",
  identifier: "CSCN",
  maxBytes: 24_004_096,
  maxTables: () => 64,
  root: [
    { type: number(2) },
    { type: number(8) },
    { type: number(8) },
    { type: POSE, required: true },
    { type: vector(4), required: true },
    { type: vector(4), required: true },
    { type: vector(4), required: true },
  ],
};

/** Reads and checks a scan. Throws FormatError. */
export function readScan(bytes: Uint8Array): Scan {
  const wire = WireScan.getRootAsScan(verifiedBuffer(bytes, SCAN));
  const count = wire.xLength();
  if (wire.yLength() !== count || wire.zLength() !== count) corrupt("The scan's x, y and z are not equally long.");
  if (count > MAX_POINTS) tooLarge(`The scan has ${count} points; at most ${MAX_POINTS} are read.`);
  const column = (values: Float32Array | null): Float32Array => (count > 0 ? values! : new Float32Array());
  return {
    index: wire.index(),
    stampNs: wire.stampNs(),
    T_odom_sensor: readPose(wire.tOdomSensor()!, "The scan's pose"),
    x: column(wire.xArray()),
    y: column(wire.yArray()),
    z: column(wire.zArray()),
  };
}
