import { PoseGraph as WirePoseGraph, type Constraint as WireConstraint } from "@schema/pose_graph_generated";

import { POSE } from "./cell";
import { corrupt, unsupported } from "./error";
import { number, struct, tables, type FileShape, type TableShape, vector, verifiedBuffer } from "./flatbuffer";
import { isPositiveSemidefinite, trace } from "./matrix6";
import { type Pose, readPose } from "./pose";

/** How well the registration behind a constraint agreed. */
export interface Scores {
  points: number;
  hits: number;
  inlierRatioAll: number;
  inlierRatioHit: number;
  shareInFront: number;
  shareBeyond: number;
  medianResidualM: number;
}

/** A measured relative pose of two CELLs (FORMAT.md, "Pose graph"). */
export interface Constraint {
  id: number;
  from: number;
  to: number;
  kind: "odometry" | "bidirectional" | "loop";
  origin: "mapper" | "detection" | "user";
  T_from_to: Pose;
  /** Upper triangle by rows, translation before rotation. */
  information: Float64Array;
  scores: Scores;
  weight: number;
  pinned: boolean;
}

/** Where the CELLs of a map are at one revision. */
export interface PoseGraph {
  revision: bigint;
  cells: Uint32Array;
  poses: Pose[];
  constraints: Constraint[];
  unaligned: Uint32Array;
}

export const CONSTRAINT: TableShape = [
  { type: number(4) },
  { type: number(4) },
  { type: number(4) },
  { type: number(1) },
  { type: number(1) },
  { type: POSE, required: true },
  { type: struct(168), required: true },
  { type: struct(48) },
  { type: number(8) },
  { type: number(1) },
];

const POSE_GRAPH: FileShape = {
  name: "pose graph",
  identifier: "CPGR",
  maxBytes: 512 * 2 ** 20,
  maxTables: (bytes) => 64 + Math.floor(bytes / 256),
  root: [
    { type: number(2) },
    { type: number(8) },
    { type: vector(104, 8), required: true },
    { type: tables(CONSTRAINT), required: true },
    { type: vector(4) },
  ],
};

const KINDS = [undefined, "odometry", "bidirectional", "loop"] as const;
const ORIGINS = [undefined, "mapper", "detection", "user"] as const;

function readScores(wire: WireConstraint, what: string): Scores {
  const s = wire.scores();
  const scores: Scores = {
    points: s?.points() ?? 0,
    hits: s?.hits() ?? 0,
    inlierRatioAll: s?.inlierRatioAll() ?? 0,
    inlierRatioHit: s?.inlierRatioHit() ?? 0,
    shareInFront: s?.shareInFront() ?? 0,
    shareBeyond: s?.shareBeyond() ?? 0,
    medianResidualM: s?.medianResidualM() ?? 0,
  };
  const shares = [scores.inlierRatioAll, scores.inlierRatioHit, scores.shareInFront, scores.shareBeyond];
  const residual = scores.medianResidualM;
  const sound = scores.hits <= scores.points && shares.every((x) => x >= 0 && x <= 1) && residual >= 0 && residual < Infinity;
  if (!sound) corrupt(`${what} has scores that cannot be.`);
  return scores;
}

function readInformation(wire: WireConstraint, what: string): Float64Array {
  const m = wire.information()!;
  const information = Float64Array.of(
    m.m00(), m.m01(), m.m02(), m.m03(), m.m04(), m.m05(), //
    m.m11(), m.m12(), m.m13(), m.m14(), m.m15(), //
    m.m22(), m.m23(), m.m24(), m.m25(), //
    m.m33(), m.m34(), m.m35(), //
    m.m44(), m.m45(), //
    m.m55(),
  );
  if (!information.every(Number.isFinite) || !(trace(information) > 0) || !isPositiveSemidefinite(information)) {
    corrupt(`${what} has no valid information matrix.`);
  }
  return information;
}

/** A constraint by its own rules; whether its ends are there depends on the file. */
export function readConstraint(wire: WireConstraint): Constraint {
  const what = `Constraint ${wire.id()}`;
  if (wire.from() === wire.to()) corrupt(`${what} ties CELL ${wire.from()} to itself.`);
  if (wire.kind() === 0 || wire.origin() === 0) corrupt(`${what} states no kind or no origin.`);
  const kind = KINDS[wire.kind()] ?? unsupported(`${what} is of kind ${wire.kind()}, which is not known.`);
  const origin = ORIGINS[wire.origin()] ?? unsupported(`${what} is of origin ${wire.origin()}, which is not known.`);
  const weight = wire.weight();
  if (!(weight >= 0 && weight <= 1)) corrupt(`${what} has weight ${weight}, which is not from 0 to 1.`);
  return {
    id: wire.id(),
    from: wire.from(),
    to: wire.to(),
    kind,
    origin,
    T_from_to: readPose(wire.tFromTo()!, what),
    information: readInformation(wire, what),
    scores: readScores(wire, what),
    weight,
    pinned: wire.pinned(),
  };
}

export function checkIncreasing(ids: ArrayLike<number>, what: string): void {
  for (let i = 1; i < ids.length; ++i) {
    if (ids[i]! <= ids[i - 1]!) corrupt(`${what} are not strictly increasing.`);
  }
}

/** Unique and increasing along the vector; 0 anywhere. */
function checkConstraints(constraints: Constraint[], cells: Set<number>): void {
  let last = 0;
  for (const { id, from, to } of constraints) {
    if (!cells.has(from) || !cells.has(to)) corrupt(`Constraint ${id} ties CELLs ${from} and ${to}, which are not both there.`);
    if (id === 0) continue;
    if (id <= last) corrupt("The constraints are not in order of their ids.");
    last = id;
  }
}

/** Reads and checks a pose graph. Throws FormatError. */
export function readPoseGraph(bytes: Uint8Array): PoseGraph {
  const wire = WirePoseGraph.getRootAsPoseGraph(verifiedBuffer(bytes, POSE_GRAPH));
  const cells = new Uint32Array(wire.nodesLength());
  const poses: Pose[] = [];
  for (let i = 0; i < cells.length; ++i) {
    const node = wire.nodes(i)!;
    cells[i] = node.cell();
    poses.push(readPose(node.tMapCell()!, `The pose of CELL ${node.cell()}`));
  }
  checkIncreasing(cells, "The CELLs of the pose graph");
  const known = new Set(cells);
  const constraints: Constraint[] = [];
  for (let i = 0; i < wire.constraintsLength(); ++i) constraints.push(readConstraint(wire.constraints(i)!));
  checkConstraints(constraints, known);
  const unaligned = wire.unalignedArray()?.slice() ?? new Uint32Array();
  checkIncreasing(unaligned, "The unaligned CELLs");
  if (!unaligned.every((id) => known.has(id))) corrupt("An unaligned CELL is not in the pose graph.");
  return { revision: wire.revision(), cells, poses, constraints, unaligned };
}
