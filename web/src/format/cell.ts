import { Cell as WireCell } from "@schema/cell_generated";
import type { Statistics as WireStatistics } from "@schema/cell_generated";

import { checkContentHash } from "./contentHash";
import { corrupt } from "./error";
import { number, string, struct, table, type FileShape, type TableShape, vector, verifiedBuffer } from "./flatbuffer";
import { latticeId, type LatticeId, type Lattice, type Lattices } from "./lattice";
import { type Pose, readPose } from "./pose";

/** How a CELL was made: counts. */
export interface Statistics {
  points: bigint;
  pointsInPlanes: bigint;
  patchesHit: number;
  rejectedFewPoints: number;
  rejectedGap: number;
  rejectedPlanarity: number;
  rejectedGrazing: number;
}

/** A CELL (FORMAT.md, "CELL"). Plane k is planes[4k ... 4k+3]: distance, nx, ny, nz, of lattice point indices[k]. */
export interface Cell {
  hash: string;
  lattice: LatticeId;
  indices: Uint32Array;
  planes: Float32Array;
  session: string;
  sequence: number;
  T_odom_cell: Pose;
  firstStampNs: bigint;
  lastStampNs: bigint;
  firstScan: number;
  scanCount: number;
  statistics: Statistics;
}

export const MAX_CELL_BYTES = 25_165_824;
export const HASH = struct(32);
export const POSE = struct(96);
export const LATTICE: TableShape = [{ type: number(1) }, { type: number(1) }, { type: number(4) }];

/** The fields that a CELL and a coded CELL share: session to statistics. */
export const ORIGIN: TableShape = [
  { type: string, required: true },
  { type: number(4) },
  { type: POSE, required: true },
  { type: number(8) },
  { type: number(8) },
  { type: number(4) },
  { type: number(4) },
  { type: table([8, 8, 4, 4, 4, 4, 4].map((size) => ({ type: number(size) }))) },
];

const CELL: FileShape = {
  name: "CELL",
  identifier: "CELL",
  maxBytes: MAX_CELL_BYTES,
  maxTables: () => 64,
  root: [
    { type: number(2) },
    { type: HASH, required: true },
    { type: table(LATTICE), required: true },
    { type: vector(4), required: true },
    { type: vector(16, 4), required: true },
    ...ORIGIN,
  ],
};

/** Where a CELL came from, as both files state it. */
interface WireOrigin {
  session(): string | null;
  sequence(): number;
  tOdomCell(): Parameters<typeof readPose>[0] | null;
  firstStampNs(): bigint;
  lastStampNs(): bigint;
  firstScan(): number;
  scanCount(): number;
  statistics(): WireStatistics | null;
}

export function readOrigin(wire: WireOrigin): Omit<Cell, "hash" | "lattice" | "indices" | "planes"> {
  const firstStampNs = wire.firstStampNs();
  const lastStampNs = wire.lastStampNs();
  if (firstStampNs > lastStampNs) corrupt("The CELL's first stamp is later than its last.");
  const s = wire.statistics();
  return {
    session: checkSession(wire.session()!),
    sequence: wire.sequence(),
    T_odom_cell: readPose(wire.tOdomCell()!, "The CELL's pose"),
    firstStampNs,
    lastStampNs,
    firstScan: wire.firstScan(),
    scanCount: wire.scanCount(),
    statistics: {
      points: s?.points() ?? 0n,
      pointsInPlanes: s?.pointsInPlanes() ?? 0n,
      patchesHit: s?.patchesHit() ?? 0,
      rejectedFewPoints: s?.rejectedFewPoints() ?? 0,
      rejectedGap: s?.rejectedGap() ?? 0,
      rejectedPlanarity: s?.rejectedPlanarity() ?? 0,
      rejectedGrazing: s?.rejectedGrazing() ?? 0,
    },
  };
}

export function checkSession(name: string): string {
  if (!/^[A-Za-z0-9._-]{1,64}$/.test(name)) corrupt("A session is named by 1 to 64 of the characters A-Z a-z 0-9 . _ -");
  return name;
}

/** Strictly increasing, on the lattice. */
export function checkIndices(indices: Uint32Array, lattice: Lattice): void {
  for (let k = 0; k < indices.length; ++k) {
    if (indices[k]! >= lattice.count) corrupt(`Lattice point ${indices[k]} is none of ${lattice.count}.`);
    if (k > 0 && indices[k]! <= indices[k - 1]!) corrupt("The CELL's lattice points are not strictly increasing.");
  }
}

/** Each plane: finite, at a sound distance, with a unit normal that faces the origin. */
export function checkPlanes(indices: Uint32Array, planes: Float32Array, lattice: Lattice): void {
  const u = lattice.directions;
  for (let k = 0; k < indices.length; ++k) {
    const distance = planes[4 * k]!;
    const nx = planes[4 * k + 1]!;
    const ny = planes[4 * k + 2]!;
    const nz = planes[4 * k + 3]!;
    const i = 3 * indices[k]!;
    const facing = nx * u[i]! + ny * u[i + 1]! + nz * u[i + 2]!;
    const norm = Math.sqrt(nx * nx + ny * ny + nz * nz);
    // Written so that NaN fails.
    if (!(distance > 0 && distance <= 10_000 && Math.abs(norm - 1) <= 1e-3 && facing < 0)) {
      corrupt(`Plane ${k} (lattice point ${indices[k]}) is none: distance ${distance}, normal (${nx}, ${ny}, ${nz}).`);
    }
  }
}

/** Reads and checks a CELL. Throws FormatError. */
export async function readCell(bytes: Uint8Array, lattices: Lattices): Promise<Cell> {
  const buffer = verifiedBuffer(bytes, CELL);
  const wire = WireCell.getRootAsCell(buffer);
  const hash = await checkContentHash(buffer.bytes(), wire.contentHash()!, "CELL");
  const l = wire.lattice()!;
  const id = latticeId(l.kind(), l.version(), l.size());
  const lattice = lattices.get(id);
  const count = wire.indicesLength();
  if (count > lattice.count) corrupt(`The CELL names ${count} lattice points; its lattice has ${lattice.count}.`);
  if (wire.planesLength() !== count) corrupt(`The CELL has ${count} lattice points but ${wire.planesLength()} planes.`);
  const indices = count > 0 ? wire.indicesArray()! : new Uint32Array();
  const first = count > 0 ? wire.planes(0)!.bb_pos : 0;
  const planes = new Float32Array(buffer.bytes().buffer as ArrayBuffer, first, 4 * count);
  checkIndices(indices, lattice);
  checkPlanes(indices, planes, lattice);
  return { hash, lattice: id, indices, planes, ...readOrigin(wire) };
}
