import { Changes as WireChanges, type AddedCell as WireAddedCell } from "@schema/changes_generated";
import type { Ids } from "@schema/changes_generated";

import { checkSession, HASH, POSE } from "./cell";
import { readColumn } from "./columns";
import { hashText } from "./contentHash";
import { corrupt, tooLarge } from "./error";
import { number, string, table, tables, type FileShape, type TableShape, vector, verifiedBuffer } from "./flatbuffer";
import { type Pose, readPose } from "./pose";
import { checkIncreasing, type Constraint, CONSTRAINT, readConstraint } from "./poseGraph";

export interface AddedCell {
  cell: number;
  hash: string;
  added: bigint;
  moved: bigint;
  T_map_cell: Pose;
  session: string;
  sequence: number;
  planes: number;
  encodedBytes: bigint;
}

/** What leads from revision `since` to `revision` (FORMAT.md, "Changes"). */
export interface Changes {
  since: bigint;
  revision: bigint;
  added: AddedCell[];
  moved: { cell: number; T_map_cell: Pose }[];
  removed: number[];
  addedConstraints: Constraint[];
  removedConstraints: number[];
  unaligned: number[];
  judged: { constraint: number; weight: number; pinned: boolean }[];
}

const MAX_IDS = 2_097_152;
const IDS: TableShape = [{ type: number(4) }, { type: vector(1), required: true }];
const bytes = vector(1);

const CHANGES: FileShape = {
  name: "file of changes",
  identifier: "CCHG",
  maxBytes: 512 * 2 ** 20,
  maxTables: (size) => 64 + Math.floor(size / 128),
  root: [
    { type: number(2) },
    { type: number(8) },
    { type: number(8) },
    {
      type: tables([
        { type: number(4) },
        { type: HASH, required: true },
        { type: number(8) },
        { type: number(8) },
        { type: POSE, required: true },
        { type: string, required: true },
        { type: number(4) },
        { type: number(4) },
        { type: number(8) },
      ]),
      required: true,
    },
    { type: table([{ type: table(IDS), required: true }, ...Array(6).fill({ type: bytes, required: true })]) },
    { type: table(IDS) },
    { type: tables(CONSTRAINT), required: true },
    { type: table(IDS) },
    { type: table(IDS) },
    { type: table([{ type: table(IDS), required: true }, { type: vector(8), required: true }, { type: bytes, required: true }]) },
  ],
};

function readIds(wire: Ids | null, what: string): number[] {
  if (!wire) return [];
  const count = wire.count();
  if (count === 0) corrupt(`${what}: a list of no ids should be absent.`);
  if (count > MAX_IDS) tooLarge(`${what}: ${count} ids are more than ${MAX_IDS}.`);
  const column = wire.idsArray()!;
  const ids = readColumn(column, count, what).map(Number);
  // Without bytes all are 0, so there can be one at most.
  if (column.length < count && !(count === 1 && ids[0] === 0)) corrupt(`${what}: a column without bytes.`);
  if (ids.some((id) => id < 0 || id >= 2 ** 32)) corrupt(`${what}: an id is not from 0 to 2^32 - 1.`);
  checkIncreasing(ids, what);
  return ids;
}

function readAdded(wire: WireAddedCell, since: bigint, revision: bigint): AddedCell {
  const cell: AddedCell = {
    cell: wire.cell(),
    hash: hashText(wire.hash()!),
    added: wire.added(),
    moved: wire.moved(),
    T_map_cell: readPose(wire.tMapCell()!, `The pose of CELL ${wire.cell()}`),
    session: checkSession(wire.session()!),
    sequence: wire.sequence(),
    planes: wire.planes(),
    encodedBytes: wire.encodedBytes(),
  };
  if (!(since < cell.added && cell.added <= cell.moved && cell.moved <= revision)) {
    corrupt(`CELL ${cell.cell} says revisions ${cell.added} and ${cell.moved}, outside of ${since} to ${revision}.`);
  }
  return cell;
}

/** A pose of whole steps: FORMAT.md's formula, in its order of operations. */
export function poseOfSteps(t: [number, number, number], r: [number, number, number]): Pose {
  const [x, y, z] = [r[0] * 2 ** -22, r[1] * 2 ** -22, r[2] * 2 ** -22];
  const xx = x * x;
  const yy = y * y;
  const zz = z * z;
  const s = xx + yy + zz;
  const d = (1 + s) * (1 + s);
  const c = 4 * (1 - s);
  return Float64Array.of(
    1 - (8 * (yy + zz)) / d, (8 * x * y - c * z) / d, (8 * x * z + c * y) / d, t[0] * 2 ** -13, //
    (8 * x * y + c * z) / d, 1 - (8 * (xx + zz)) / d, (8 * y * z - c * x) / d, t[1] * 2 ** -13, //
    (8 * x * z - c * y) / d, (8 * y * z + c * x) / d, 1 - (8 * (xx + yy)) / d, t[2] * 2 ** -13,
  );
}

function readMoved(wire: WireChanges): Changes["moved"] {
  const moved = wire.moved();
  if (!moved) return [];
  const cells = readIds(moved.cells(), "The moved CELLs");
  const column = (data: Uint8Array | null, limit: number, name: string): number[] => {
    const steps = readColumn(data ?? new Uint8Array(), cells.length, `Column ${name} of the moved CELLs`).map(Number);
    if (steps.some((n) => Math.abs(n) > limit)) corrupt(`Column ${name} of the moved CELLs is out of range.`);
    return steps;
  };
  const [x, y, z] = [
    column(moved.xArray(), 2 ** 37, "x"),
    column(moved.yArray(), 2 ** 37, "y"),
    column(moved.zArray(), 2 ** 37, "z"),
  ];
  const [rx, ry, rz] = [
    column(moved.rxArray(), 2 ** 22, "rx"),
    column(moved.ryArray(), 2 ** 22, "ry"),
    column(moved.rzArray(), 2 ** 22, "rz"),
  ];
  return cells.map((cell, i) => ({
    cell,
    T_map_cell: poseOfSteps([x[i]!, y[i]!, z[i]!], [rx[i]!, ry[i]!, rz[i]!]),
  }));
}

function readJudged(wire: WireChanges): Changes["judged"] {
  const judged = wire.judged();
  if (!judged) return [];
  const ids = readIds(judged.constraints(), "The judged constraints");
  if (ids[0] === 0) corrupt("A judged constraint has no id.");
  if (judged.weightLength() !== ids.length || judged.pinnedLength() !== ids.length) {
    corrupt("The columns of the judged constraints are not equally long.");
  }
  return ids.map((constraint, i) => {
    const weight = judged.weight(i)!;
    if (!(weight >= 0 && weight <= 1)) corrupt(`Constraint ${constraint} has weight ${weight}, which is not from 0 to 1.`);
    return { constraint, weight, pinned: judged.pinned(i)! };
  });
}

/** No id may be in both lists. */
function checkApart(a: number[], b: number[], message: string): void {
  const known = new Set(a);
  if (b.some((id) => known.has(id))) corrupt(message);
}

/** Reads and checks a file of changes. Throws FormatError. */
export function readChanges(file: Uint8Array): Changes {
  const wire = WireChanges.getRootAsChanges(verifiedBuffer(file, CHANGES));
  const since = wire.since();
  const revision = wire.revision();
  if (since > revision) corrupt(`Changes lead from ${since} back to ${revision}.`);
  const added: AddedCell[] = [];
  for (let i = 0; i < wire.addedLength(); ++i) added.push(readAdded(wire.added(i)!, since, revision));
  const addedConstraints: Constraint[] = [];
  for (let i = 0; i < wire.addedConstraintsLength(); ++i) addedConstraints.push(readConstraint(wire.addedConstraints(i)!));
  const moved = readMoved(wire);
  const judged = readJudged(wire);
  const addedIds = added.map(({ cell }) => cell);
  const constraintIds = addedConstraints.map(({ id }) => id);
  checkIncreasing(addedIds, "The added CELLs");
  checkIncreasing([0, ...constraintIds], "The added constraints");
  checkApart(addedIds, moved.map(({ cell }) => cell), "A CELL is both added and moved.");
  checkApart(constraintIds, judged.map(({ constraint }) => constraint), "A constraint is both added and judged anew.");
  return {
    since,
    revision,
    added,
    moved,
    removed: readIds(wire.removed(), "The removed CELLs"),
    addedConstraints,
    removedConstraints: readIds(wire.removedConstraints(), "The removed constraints"),
    unaligned: readIds(wire.unaligned(), "The unaligned CELLs"),
    judged,
  };
}
