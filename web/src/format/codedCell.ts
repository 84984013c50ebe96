import { CodedCell as WireCodedCell } from "@schema/coded_cell_generated";

import { type Cell, checkPlanes, HASH, LATTICE, MAX_CELL_BYTES, ORIGIN, readOrigin } from "./cell";
import { readCompactPlanes } from "./compactPlanes";
import { checkContentHash, hashText, hexText } from "./contentHash";
import { corrupt, unsupported } from "./error";
import { type FileShape, number, table, vector, verifiedBuffer } from "./flatbuffer";
import { latticeId, type Lattice, type Lattices } from "./lattice";
import { Layer } from "./layer";
import { readPackedPlanes } from "./packedPlanes";
import { KnownPlanes } from "./planePrediction";
import { sha256 } from "./sha256";

const CODED_CELL: FileShape = {
  name: "coded CELL",
  identifier: "CCOD",
  maxBytes: MAX_CELL_BYTES,
  maxTables: () => 64,
  root: [
    { type: number(2) },
    { type: HASH, required: true },
    { type: HASH, required: true },
    { type: HASH, required: true },
    { type: number(1) },
    { type: number(4) },
    { type: table(LATTICE), required: true },
    { type: number(4) },
    { type: number(4) },
    { type: number(4) },
    ...ORIGIN,
    { type: vector(1), required: true },
  ],
};

/** A CELL that came coded: `rawHash` names the CELL that was coded, `hash` these bytes. */
export interface CodedCell extends Cell {
  rawHash: string;
  /** How far a point of a plane may have moved, metres; 0: not at all. */
  boundM: number;
  coarsePlanes: number;
}

/** Values of `encoding`: packed, then the versions of compact. */
const PACKED = 1;
const COMPACT_VERSIONS: ReadonlyMap<number, 1 | 2> = new Map([
  [2, 1],
  [3, 2],
]);

/** What `coarse_hash` is of: the file's beginning, with zeros in place of both hashes. */
async function checkCoarseHash(file: Uint8Array, wire: WireCodedCell, end: number): Promise<void> {
  const beginning = file.slice(0, end);
  for (const hash of [wire.contentHash()!, wire.coarseHash()!]) beginning.fill(0, hash.bb_pos, hash.bb_pos + 32);
  if (hexText(await sha256(beginning)) !== hashText(wire.coarseHash()!)) corrupt("The coarse layer is not what its hash says.");
}

/** Decodes so many layers, each in the order of its index, and puts the planes in the order of theirs. */
function readPlanes(wire: WireCodedCell, lattice: Lattice, layers: 1 | 2): { indices: Uint32Array; planes: Float32Array } {
  const [total, coarse] = [wire.planeCount(), wire.coarsePlaneCount()];
  const data = wire.dataArray() ?? new Uint8Array();
  const version = COMPACT_VERSIONS.get(wire.encoding());
  const known = new KnownPlanes(lattice, version === 2);
  const present = new Uint8Array(lattice.count);
  const planes = new Float32Array(4 * lattice.count);
  const bytes = [data.subarray(0, wire.coarseBytes()), data.subarray(wire.coarseBytes())];
  bytes.slice(0, layers).forEach((part, i) => {
    const layer = new Layer(lattice, i as 0 | 1, present);
    const count = i === 0 ? coarse : total - coarse;
    if (version) readCompactPlanes(part, layer, count, wire.boundUm(), version, known, planes);
    else readPackedPlanes(part, layer, count, known, planes);
  });
  const read = layers === 1 ? coarse : total;
  const indices = new Uint32Array(read);
  const inOrder = new Float32Array(4 * read);
  let k = 0;
  for (let index = 0; index < lattice.count; ++index) {
    if (!present[index]) continue;
    indices[k] = index;
    inOrder.set(planes.subarray(4 * index, 4 * index + 4), 4 * k++);
  }
  return { indices, planes: inOrder };
}

/** Reads and checks a coded CELL. Throws FormatError. */
export async function readCodedCell(bytes: Uint8Array, lattices: Lattices): Promise<CodedCell> {
  const buffer = verifiedBuffer(bytes, CODED_CELL);
  const wire = WireCodedCell.getRootAsCodedCell(buffer);
  return readLayers(wire, buffer.bytes(), await checkContentHash(buffer.bytes(), wire.contentHash()!, "coded CELL"), lattices, 2);
}

/** The coarse layer, a quarter of the planes, of the first bytes of a coded CELL of `fileBytes` bytes. Throws FormatError. */
export async function readCoarseCell(beginning: Uint8Array, fileBytes: number, lattices: Lattices): Promise<CodedCell> {
  if (!(beginning.length <= fileBytes && fileBytes <= MAX_CELL_BYTES)) corrupt(`${beginning.length} bytes are no beginning of ${fileBytes}.`);
  const padded = new Uint8Array(fileBytes);
  padded.set(beginning);
  const buffer = verifiedBuffer(padded, CODED_CELL);
  const wire = WireCodedCell.getRootAsCodedCell(buffer);
  const end = (wire.dataArray()?.byteOffset ?? 0) + wire.coarseBytes();
  if (end > beginning.length) corrupt("The coarse layer of the coded CELL was cut off.");
  return readLayers(wire, buffer.bytes(), hashText(wire.contentHash()!), lattices, 1);
}

async function readLayers(wire: WireCodedCell, file: Uint8Array, hash: string, lattices: Lattices, layers: 1 | 2): Promise<CodedCell> {
  const encoding = wire.encoding();
  if (encoding !== PACKED && !COMPACT_VERSIONS.has(encoding)) unsupported(`Encoding ${encoding} of a coded CELL is not known.`);
  const bound = wire.boundUm();
  if (encoding === PACKED ? bound !== 0 : bound < 1000 || bound > 1_000_000) corrupt(`The coded CELL states a bound of ${bound} micrometres.`);
  const l = wire.lattice()!;
  const id = latticeId(l.kind(), l.version(), l.size());
  const lattice = lattices.get(id);
  if (wire.planeCount() > lattice.count || wire.coarsePlaneCount() > wire.planeCount() || wire.coarseBytes() > wire.dataLength()) {
    corrupt("The coded CELL's counts do not fit each other.");
  }
  const dataEnd = (wire.dataArray()?.byteOffset ?? 0) + wire.dataLength();
  if (wire.dataLength() > 0 && file.length - dataEnd > 7) corrupt("The coded CELL's data is not the last of the file.");
  if (wire.dataLength() > 0) await checkCoarseHash(file, wire, dataEnd - wire.dataLength() + wire.coarseBytes());
  const { indices, planes } = readPlanes(wire, lattice, layers);
  checkPlanes(indices, planes, lattice);
  return {
    hash,
    rawHash: hashText(wire.rawHash()!),
    boundM: bound * 1e-6,
    coarsePlanes: wire.coarsePlaneCount(),
    lattice: id,
    indices,
    planes,
    ...readOrigin(wire),
  };
}
