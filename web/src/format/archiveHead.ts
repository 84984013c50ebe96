import { corrupt, unsupported } from "./error";
import { latticeId, type LatticeId } from "./lattice";
import { xxh3 } from "./xxh3";

// FORMAT.md, "Archive": head, states and tail, which are no FlatBuffers.

export const HEAD_BYTES = 16_384;
const ROOT_AT = 1536;
const SLOTS = [512, 1024];
export const TAIL_BYTES = 72;
const HEAD_MAGIC = "8943454c4c4d4150";
const TAIL_MAGIC = "50414d4c4c454389";

export interface ArchiveHead {
  lattice: LatticeId;
  cells: number;
  recordsEnd: number;
  dataEnd: number;
  hasLeaves: boolean;
  /** The root directory's zstd frame. */
  root: Uint8Array;
}

export interface ArchiveState {
  serial: number;
  block: number;
  footer: number;
  footerBytes: number;
  footerSum: bigint;
  end: number;
}

const viewOf = (bytes: Uint8Array): DataView => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
const digits = (bytes: Uint8Array): string => Array.from(bytes, (b) => b.toString(16).padStart(2, "0")).join("");

/** A 64-bit number that must be a length or place in a file. */
export function wholeNumber(value: bigint, what: string): number {
  if (value > BigInt(Number.MAX_SAFE_INTEGER)) corrupt(`${what} of the archive is ${value}.`);
  return Number(value);
}

export function readHead(bytes: Uint8Array): ArchiveHead {
  if (bytes.length < HEAD_BYTES || digits(bytes.subarray(0, 8)) !== HEAD_MAGIC) corrupt("This is no CELLmap archive.");
  const view = viewOf(bytes);
  const version = view.getUint16(8, true);
  if (version !== 1) unsupported(`This archive is of version ${version}; version 1 can be read.`);
  if (xxh3(bytes.subarray(0, 56)) !== view.getBigUint64(56, true)) corrupt("The archive's head is damaged.");
  const number = (at: number): number => wholeNumber(view.getBigUint64(at, true), "A number in the head");
  const rootBytes = view.getUint32(40, true);
  const flags = view.getUint32(44, true);
  if (rootBytes === 0) corrupt("The archive was not finished by its writer.");
  if (rootBytes > HEAD_BYTES - ROOT_AT || flags > 1) corrupt("The archive's head is not valid.");
  const root = bytes.slice(ROOT_AT, ROOT_AT + rootBytes);
  if (xxh3(root) !== view.getBigUint64(48, true)) corrupt("The archive's root directory is damaged.");
  const head = {
    lattice: latticeId(view.getUint8(10), view.getUint8(11), view.getUint32(12, true)),
    cells: number(16),
    recordsEnd: number(24),
    dataEnd: number(32),
    hasLeaves: flags === 1,
    root,
  };
  if (head.recordsEnd < HEAD_BYTES || head.dataEnd < head.recordsEnd) corrupt("The archive's head is not valid.");
  return head;
}

function readState(bytes: Uint8Array): ArchiveState | null {
  const view = viewOf(bytes);
  if (xxh3(bytes.subarray(0, 56)) !== view.getBigUint64(56, true)) return null;
  const number = (i: number): number => wholeNumber(view.getBigUint64(8 * i, true), "A number in the state");
  const state = { serial: number(0), block: number(1), footer: number(2), footerBytes: number(3), footerSum: view.getBigUint64(32, true), end: number(5) };
  const tailAt = Math.ceil((state.footer + state.footerBytes) / 8) * 8;
  const sound = state.serial > 0 && HEAD_BYTES <= state.block && state.block <= state.footer && tailAt + TAIL_BYTES === state.end;
  return sound ? state : null;
}

/** The state that holds: of the two slots the valid one with the higher serial, each in its place. */
export function newestState(head: Uint8Array): ArchiveState {
  const states = SLOTS.map((at, i) => {
    const state = readState(head.subarray(at, at + 64));
    return state && state.serial % 2 === i ? state : null;
  }).filter((state) => state !== null);
  const newest = states.sort((a, b) => b.serial - a.serial)[0];
  return newest ?? corrupt("The archive has no valid state: its writer did not finish, or its head is damaged.");
}

/** The tail says the same as the state, and ends the archive. */
export function checkTail(tail: Uint8Array, state: ArchiveState): void {
  const found = readState(tail.subarray(0, 64));
  if (digits(tail.subarray(64, 72)) !== TAIL_MAGIC || found?.serial !== state.serial || found.end !== state.end) {
    corrupt("The archive does not end as its head says.");
  }
}
