import { ArchiveCells } from "@schema/cellmap/schema/archive-cells";
import { ArchiveDirectory } from "@schema/cellmap/schema/archive-directory";
import { ArchiveFooter } from "@schema/cellmap/schema/archive-footer";

import { type ArchiveHead, type ArchiveState, checkTail, HEAD_BYTES, newestState, readHead, TAIL_BYTES, wholeNumber } from "./archiveHead";
import type { ByteSource } from "./byteSource";
import { checkSession, LATTICE, MAX_CELL_BYTES, POSE } from "./cell";
import { type Changes, readChanges } from "./changes";
import { readColumn } from "./columns";
import { hashText } from "./contentHash";
import { corrupt, unsupported } from "./error";
import { type FileShape, number, string, table, tables, type TableShape, vector, verifiedBuffer } from "./flatbuffer";
import { type LatticeId } from "./lattice";
import { checkIncreasing, type PoseGraph, readPoseGraph } from "./poseGraph";
import { xxh3 } from "./xxh3";
import { zstdDecompress } from "./zstd";

// FORMAT.md, "Archive": one file that is a whole map, read in pieces.

const bytes = vector(1);
const required = (type: TableShape[number]["type"]): TableShape[number] => ({ type, required: true });
const MAX_PART = 64 << 20;
const few = (): number => 64;

const DIRECTORY: FileShape = {
  name: "archive's directory", identifier: "CADR", maxBytes: MAX_PART, maxTables: few,
  root: [{ type: number(2) }, { type: number(4) }, required(bytes), required(bytes), required(bytes), { type: vector(8) }],
};
const CELL_LIST: FileShape = {
  name: "archive's list of CELLs", identifier: "CACL", maxBytes: 512 << 20, maxTables: few,
  root: [{ type: number(2) }, { type: number(4) }, required(bytes), required(vector(32, 8)), ...Array(4).fill(required(bytes))],
};
const SESSION: TableShape = [required(string), { type: string }, { type: string }, { type: string }, { type: number(8) }];
const SECTION: TableShape = [{ type: number(1) }, { type: number(8) }, { type: number(8) }, { type: number(8) }];
const FOOTER: FileShape = {
  name: "archive's footer", identifier: "CAFT", maxBytes: MAX_PART, maxTables: (size) => 64 + Math.floor(size / 16),
  root: [
    { type: number(2) }, required(string), { type: number(8) }, required(table(LATTICE)), { type: number(1) }, { type: number(4) },
    ...[8, 8, 8, 8, 8].map((size) => ({ type: number(size) })), required(tables(SESSION)),
    { type: table([{ type: number(8) }, { type: number(8) }, { type: number(8) }, required(POSE)]) }, required(tables(SECTION)),
  ],
};

const RECORD_HEAD = 32;
const RECORD_MAGIC = 0x1a0a0d4c4c454389n;

export interface ArchivedCell {
  id: number;
  hash: string;
  session: string;
  sequence: number;
  planes: number;
  bytes: number;
}

interface Place {
  offset: number;
  length: number;
}

/** What an archive says of its map, without its CELLs. */
export interface ArchiveSummary {
  map: string;
  lattice: LatticeId;
  revision: number;
  planes: number;
  scans: number;
  cellBytes: number;
  encoding: "raw" | "packed" | "compact";
  boundM: number;
  sessions: { name: string; robot: string; sensor: string }[];
}

/** Columns of ids and sizes, as numbers. */
const column = (data: Uint8Array | null, count: number, what: string): number[] =>
  readColumn(data ?? new Uint8Array(), count, what).map((value) => {
    if (value < 0n || value > BigInt(Number.MAX_SAFE_INTEGER)) corrupt(`${what} holds ${value}.`);
    return Number(value);
  });

/** An opened archive. All methods throw FormatError; reads of records may also throw SourceChanged. */
export class Archive {
  private constructor(
    private readonly source: ByteSource,
    readonly summary: ArchiveSummary,
    readonly cells: ArchivedCell[],
    readonly poseGraph: PoseGraph,
    /** What happened after the pose graph's revision. */
    readonly changes: Changes | null,
    private readonly places: Map<number, Place>,
    /** Bytes of all records. */
    readonly storedBytes: number,
  ) {}

  static async open(source: ByteSource): Promise<Archive> {
    const first = await source.read(0, HEAD_BYTES);
    const head = readHead(first);
    const state = newestState(first);
    if (source.size < state.end) corrupt(`The archive was cut off: it has ${source.size} bytes of ${state.end}.`);
    const reader = await BlockReader.open(source, state);
    const footer = ArchiveFooter.getRootAsArchiveFooter(verifiedBuffer(reader.footer, FOOTER));
    const summary = readSummary(footer, head);
    const section = async (kind: number, limit: number): Promise<Uint8Array | null> => reader.section(footer, kind, limit);
    const graph = await section(1, 512 << 20);
    const list = await section(3, 512 << 20);
    if (!graph || !list) corrupt("The archive lacks its pose graph or its list of CELLs.");
    const changes = await section(2, 512 << 20);
    const places = await readPlaces(source, head);
    const cells = readCellList(list, summary);
    if (cells.length !== head.cells || cells.some(({ id }) => !places.has(id))) corrupt("The archive's list of CELLs does not fit its directory.");
    const stored = [...places.values()].reduce((sum, { length }) => sum + length, 0);
    return new Archive(source, summary, cells, readPoseGraph(graph), changes ? readChanges(changes) : null, places, stored);
  }

  /** The payload of a record, in one read: a CELL's bytes, or those of a coded CELL. */
  async cell(id: number): Promise<Uint8Array> {
    const place = this.places.get(id) ?? corrupt(`The archive has no CELL ${id}.`);
    const record = await this.source.read(place.offset, place.length);
    if (record.length !== place.length) corrupt(`The record of CELL ${id} is cut off.`);
    const view = new DataView(record.buffer, record.byteOffset, record.byteLength);
    const payload = record.subarray(RECORD_HEAD);
    const sound =
      view.getBigUint64(0, true) === RECORD_MAGIC &&
      view.getUint32(8, true) === id &&
      view.getUint32(12, true) === payload.length &&
      (xxh3(record.subarray(0, 28)) & 0xffffffffn) === BigInt(view.getUint32(28, true)) &&
      xxh3(payload) === view.getBigUint64(16, true);
    if (!sound) corrupt(`The record of CELL ${id} is damaged.`);
    return view.getUint32(24, true) === 1 ? zstdDecompress(payload, MAX_CELL_BYTES) : payload;
  }
}

/** The newest block's end, read at once, and other parts as they are asked for. */
class BlockReader {
  private constructor(
    private readonly source: ByteSource,
    private readonly state: ArchiveState,
    private readonly from: number,
    private readonly kept: Uint8Array,
    readonly footer: Uint8Array,
  ) {}

  static async open(source: ByteSource, state: ArchiveState): Promise<BlockReader> {
    const from = Math.min(state.footer, Math.max(state.block, state.end - (256 << 10)));
    if (state.end - from > MAX_PART) corrupt("The archive's footer is too large.");
    const kept = await source.read(from, state.end - from);
    if (kept.length !== state.end - from) corrupt("The archive was cut off.");
    checkTail(kept.subarray(kept.length - TAIL_BYTES), state);
    const footer = kept.subarray(state.footer - from, state.footer - from + state.footerBytes);
    if (xxh3(footer) !== state.footerSum) corrupt("The archive's footer is damaged.");
    return new BlockReader(source, state, from, kept, footer);
  }

  /** The content of the section of a kind, or null where there is none. */
  async section(footer: ArchiveFooter, kind: number, limit: number): Promise<Uint8Array | null> {
    for (let i = 0; i < footer.sectionsLength(); ++i) {
      const section = footer.sections(i)!;
      if (section.kind() !== kind) continue;
      const offset = wholeNumber(section.offset(), "A section's offset");
      const length = wholeNumber(section.length(), "A section's length");
      if (offset < HEAD_BYTES || offset + length > this.state.footer || length > limit) corrupt("A section lies outside of the archive.");
      const frame = offset >= this.from ? this.kept.subarray(offset - this.from, offset - this.from + length) : await this.source.read(offset, length);
      if (xxh3(frame) !== section.checksum()) corrupt(`Section ${kind} of the archive is damaged.`);
      return zstdDecompress(frame, limit);
    }
    return null;
  }
}

function readSummary(footer: ArchiveFooter, head: ArchiveHead): ArchiveSummary {
  const encoding = (["raw", "packed", "compact"] as const)[footer.encoding() - 1] ?? unsupported(`The archive's encoding ${footer.encoding()} is not known.`);
  const sessions: ArchiveSummary["sessions"] = [];
  for (let i = 0; i < footer.sessionsLength(); ++i) {
    const session = footer.sessions(i)!;
    sessions.push({ name: checkSession(session.name()!), robot: session.robot() ?? "", sensor: session.sensor() ?? "" });
  }
  return {
    map: footer.map()!,
    lattice: head.lattice,
    revision: wholeNumber(footer.revision(), "The revision"),
    planes: wholeNumber(footer.planes(), "The number of planes"),
    scans: wholeNumber(footer.scans(), "The number of scans"),
    cellBytes: wholeNumber(footer.cellBytes(), "The size of the CELLs"),
    encoding,
    boundM: footer.boundUm() * 1e-6,
    sessions,
  };
}

interface Row extends Place {
  first: number;
  checksum: bigint;
}

/** The rows of a directory: ids and where what they name lies. */
function readDirectory(frame: Uint8Array, begin: number, limit: number): Row[] {
  const wire = ArchiveDirectory.getRootAsArchiveDirectory(verifiedBuffer(zstdDecompress(frame, MAX_PART), DIRECTORY));
  const count = wire.count();
  if (count > 10_000_000) corrupt(`A directory of the archive names ${count} rows.`);
  const ids = column(wire.cellsArray(), count, "The directory's ids");
  checkIncreasing(ids, "The directory's ids");
  const gaps = column(wire.gapsArray(), count, "The directory's gaps");
  const lengths = column(wire.lengthsArray(), count, "The directory's lengths");
  let end = begin;
  return ids.map((first, i) => {
    const offset = end + 8 * gaps[i]!;
    end = Math.ceil((offset + lengths[i]!) / 8) * 8;
    if (end > limit) corrupt("A row of the archive's directory lies outside of the archive.");
    return { first, offset, length: lengths[i]!, checksum: wire.checksums(i) ?? 0n };
  });
}

async function readPlaces(source: ByteSource, head: ArchiveHead): Promise<Map<number, Place>> {
  const places = new Map<number, Place>();
  const take = (rows: Row[]): void => rows.forEach(({ first, offset, length }) => places.set(first, { offset, length }));
  if (!head.hasLeaves) {
    take(readDirectory(head.root, HEAD_BYTES, head.recordsEnd));
    return places;
  }
  // A leaf's rows begin at 16384 only for the first; each leaf says where it begins by its first gap.
  for (const { offset, length, checksum } of readDirectory(head.root, head.recordsEnd, head.dataEnd)) {
    const leaf = await source.read(offset, length);
    if (xxh3(leaf) !== checksum) corrupt("A leaf of the archive's directory is damaged.");
    take(readDirectory(leaf, HEAD_BYTES, head.recordsEnd));
  }
  return places;
}

function readCellList(content: Uint8Array, summary: ArchiveSummary): ArchivedCell[] {
  const wire = ArchiveCells.getRootAsArchiveCells(verifiedBuffer(content, CELL_LIST));
  const count = wire.count();
  if (count !== wire.hashesLength()) corrupt("The archive's list of CELLs has columns of different length.");
  const ids = column(wire.cellsArray(), count, "The ids of the CELLs");
  checkIncreasing(ids, "The ids of the CELLs");
  const session = column(wire.sessionArray(), count, "The sessions of the CELLs");
  const sequence = column(wire.sequenceArray(), count, "The sequences of the CELLs");
  const planes = column(wire.planesArray(), count, "The planes of the CELLs");
  const sizes = column(wire.bytesArray(), count, "The bytes of the CELLs");
  return ids.map((id, i) => ({
    id,
    hash: hashText(wire.hashes(i)!),
    session: summary.sessions[session[i]!]?.name ?? corrupt(`CELL ${id} is of a session that the archive does not name.`),
    sequence: sequence[i]!,
    planes: planes[i]!,
    bytes: sizes[i]!,
  }));
}
