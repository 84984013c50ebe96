import { ByteBuffer } from "flatbuffers";

import { corrupt, tooLarge, unsupported } from "./error";

// The FlatBuffers runtime for TypeScript has no verifier: generated readers follow any offset. So the offsets of
// untrusted bytes are walked here first, by a description of the schema's tables.

/** What a field holds. Sizes and alignments are bytes. */
export type FieldType =
  | { kind: "inline"; size: number; align: number } // a number or a struct
  | { kind: "vector"; size: number; align: number } // of numbers or structs
  | { kind: "string" }
  | { kind: "table"; shape: TableShape }
  | { kind: "tables"; shape: TableShape };

/** The fields of a table by their ids; `required` ones must be there. */
export type TableShape = { type: FieldType; required?: boolean }[];

export const number = (size: number): FieldType => ({ kind: "inline", size, align: size });
export const struct = (size: number): FieldType => ({ kind: "inline", size, align: 8 });
export const vector = (size: number, align = size): FieldType => ({ kind: "vector", size, align });
export const string: FieldType = { kind: "string" };
export const table = (shape: TableShape): FieldType => ({ kind: "table", shape });
export const tables = (shape: TableShape): FieldType => ({ kind: "tables", shape });

/** A kind of file: its identifier, limit, root table, and how many tables a file of some size may have. */
export interface FileShape {
  name: string;
  identifier: string;
  maxBytes: number;
  root: TableShape;
  maxTables: (bytes: number) => number;
}

const FORMAT_VERSION = 1;
const MAX_DEPTH = 16;

/**
 * Checks the size, identifier, version and every offset of a file, and returns its bytes, copied so that they begin
 * at an aligned address, for the generated readers. Throws FormatError.
 */
export function verifiedBuffer(bytes: Uint8Array, shape: FileShape): ByteBuffer {
  if (bytes.length > shape.maxBytes) {
    tooLarge(`A ${shape.name} has at most ${shape.maxBytes} bytes, this one has ${bytes.length}.`);
  }
  const copy = bytes.slice();
  const verifier = new Verifier(copy, shape);
  verifier.checkIdentifier();
  verifier.checkVersion();
  verifier.checkRoot();
  return new ByteBuffer(copy);
}

class Verifier {
  private readonly view: DataView;
  private tablesLeft: number;

  constructor(
    bytes: Uint8Array,
    private readonly shape: FileShape,
  ) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.tablesLeft = shape.maxTables(bytes.length);
  }

  checkIdentifier(): void {
    this.need(0, 8, 1);
    let found = "";
    for (let i = 4; i < 8; ++i) found += String.fromCharCode(this.view.getUint8(i));
    if (found !== this.shape.identifier) {
      corrupt(`Expected a ${this.shape.name} ("${this.shape.identifier}" at byte 4), found ${JSON.stringify(found)}.`);
    }
  }

  /** Before anything else of the file is judged, since a newer version may follow other rules. */
  checkVersion(): void {
    const root = this.rootTable();
    const field = this.fieldsOf(root)[0] ?? 0;
    if (field !== 0) this.need(root + field, 2, 2);
    const version = field === 0 ? 0 : this.view.getUint16(root + field, true);
    if (version === 0) corrupt(`This ${this.shape.name} states no version.`);
    if (version !== FORMAT_VERSION) {
      unsupported(`This ${this.shape.name} is of format version ${version}; version ${FORMAT_VERSION} can be read.`);
    }
  }

  checkRoot(): void {
    this.checkTable(this.rootTable(), this.shape.root, 1);
  }

  private rootTable(): number {
    return this.follow(0);
  }

  private need(at: number, size: number, align: number): void {
    if (at < 0 || size < 0 || at + size > this.view.byteLength || at % align !== 0) {
      corrupt(`The ${this.shape.name} is cut or damaged: ${size} bytes at ${at} do not lie in its ${this.view.byteLength}.`);
    }
  }

  /** The position that the unsigned offset at `at` leads to. */
  private follow(at: number): number {
    this.need(at, 4, 4);
    const offset = this.view.getUint32(at, true);
    if (offset === 0) corrupt(`The ${this.shape.name} has an empty offset at ${at}.`);
    return at + offset;
  }

  /** The positions of a table's fields, relative to it; 0 for absent ones. */
  private fieldsOf(position: number): number[] {
    this.need(position, 4, 4);
    const vtable = position - this.view.getInt32(position, true);
    this.need(vtable, 4, 2);
    const vtableSize = this.view.getUint16(vtable, true);
    const tableSize = this.view.getUint16(vtable + 2, true);
    if (vtableSize < 4 || vtableSize % 2 !== 0) corrupt(`The ${this.shape.name} has a table of no valid shape.`);
    this.need(vtable, vtableSize, 2);
    this.need(position, tableSize, 4);
    const fields: number[] = [];
    for (let at = 4; at < vtableSize; at += 2) fields.push(this.view.getUint16(vtable + at, true));
    return fields;
  }

  private checkTable(position: number, shape: TableShape, depth: number): void {
    if (depth > MAX_DEPTH || this.tablesLeft-- <= 0) corrupt(`The ${this.shape.name} has too many or too deep tables.`);
    const fields = this.fieldsOf(position);
    shape.forEach(({ type, required }, id) => {
      const offset = fields[id] ?? 0;
      if (offset !== 0) this.checkField(position + offset, type, depth);
      else if (required) corrupt(`The ${this.shape.name} lacks a required field (id ${id}).`);
    });
  }

  private checkField(at: number, type: FieldType, depth: number): void {
    switch (type.kind) {
      case "inline":
        return this.need(at, type.size, type.align);
      case "vector":
        this.checkVector(this.follow(at), type.size, type.align);
        return;
      case "string": {
        const start = this.follow(at);
        const length = this.checkVector(start, 1, 1);
        this.need(start + 4 + length, 1, 1);
        if (this.view.getUint8(start + 4 + length) !== 0) corrupt(`The ${this.shape.name} has a string without an end.`);
        return;
      }
      case "table":
        return this.checkTable(this.follow(at), type.shape, depth + 1);
      case "tables": {
        const start = this.follow(at);
        const length = this.checkVector(start, 4, 4);
        for (let i = 0; i < length; ++i) this.checkTable(this.follow(start + 4 + 4 * i), type.shape, depth + 1);
      }
    }
  }

  private checkVector(start: number, size: number, align: number): number {
    this.need(start, 4, 4);
    const length = this.view.getUint32(start, true);
    if (length > 0) this.need(start + 4, length * size, align);
    return length;
  }
}
