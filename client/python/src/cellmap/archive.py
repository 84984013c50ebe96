"""A whole map in one file (FORMAT.md, "Archive"), read in pieces from a disk or any web server."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import TracebackType

import numpy as np
import xxhash
from numpy.typing import NDArray

from .archived_scans import MAX_CELLS, ArchivedScans, Georeference, read_archived_scans, read_georeference
from .byte_source import ByteSource, FileSource, HttpSource
from .cell import Cell, read_cell, read_lattice
from .changes import read_changes
from .coded_cell import read_coded_cell
from .errors import Error, corrupt, unsupported
from .flatbuffer import Buffer, Table
from .lattice import Lattice, lattice_of
from .pose_graph import PoseGraph, read_pose_graph
from .wire import check_ids, decompressed, read_column, unpack_at

_MAGIC, _TAIL_MAGIC = b"\x89CELLMAP", b"PAMLLEC\x89"
_RECORD_MAGIC = b"\x89CELL\r\n\x1a"
_HEAD_BYTES, _FIRST_BYTES, _RECORD_HEAD = 16384, 16384, 32
_MAX_SECTION, _MAX_FOOTER = 512 << 20, 64 << 20
_ENCODINGS = {1: "raw", 2: "packed", 3: "compact"}
_POSE_GRAPH, _CHANGES, _CELLS, _SCANS, _SUPERSEDED = 1, 2, 3, 4, 5
_LAST_BYTES = 256 << 10


@dataclass(frozen=True)
class ArchivedCell:
    """What is known of a CELL without reading it."""

    id: int
    hash: str  #: names the CELL before it was coded
    session: str
    sequence: int
    planes: int
    bytes: int  #: as FlatBuffers, not as it lies in the archive


@dataclass(frozen=True)
class ArchiveSummary:
    map: str  #: name of the map that was archived
    created_ns: int
    lattice: Lattice
    encoding: str  #: "raw", "packed" or "compact"
    bound_m: float  #: of compact ones: how far planes may be off, along their normals
    revision: int
    cells: int
    planes: int
    scans: int
    sessions: tuple[str, ...]
    georeference: Georeference | None  #: None where nobody said where on Earth the map lies


@dataclass(frozen=True)
class _Row:
    cell: int
    begin: int
    length: int
    checksum: int | None


@dataclass
class _State:
    serial: int = 0
    block: int = 0
    footer: int = 0
    footer_bytes: int = 0
    footer_sum: int = 0
    end: int = 0
    tail: bytes = field(default=b"", repr=False)


def _sum(data: bytes) -> int:
    return int(xxhash.xxh3_64_intdigest(data))


def open_archive(path_or_url: str | Path, token: str | None = None, timeout_s: float = 30.0) -> "Archive":
    """Opens a ``.cellmap`` file, or one behind ``http://`` or ``https://``: two small requests, then one a CELL.

    ``token`` is sent as a bearer token. Error("not-found", "corrupt-data", "unsupported", "unavailable").
    """
    text = str(path_or_url)
    source: ByteSource
    if text.startswith(("http://", "https://")):
        source = HttpSource(text, token, timeout_s)
    else:
        source = FileSource(text)
    try:
        return Archive(source)
    except Error as error:
        if error.code != "precondition-failed":
            source.close()
            raise
        source.forget()  # replaced between two reads: begin anew, once
        return Archive(source)


class Archive:
    """An opened archive; also a context manager. Not thread-safe. Reads CELLs when they are asked for."""

    def __init__(self, source: ByteSource) -> None:
        self._source = source
        first = source.read(0, _FIRST_BYTES)
        self._lattice, count, self._records_end, self._data_end, root, has_leaves = _read_head(first)
        self._state = _newest_state(first)
        if source.size < self._state.end:
            raise corrupt(f"{source.name} was cut off: {source.size} of {self._state.end} bytes are there.")
        begin = max(self._state.block, self._state.end - _LAST_BYTES)
        self._last_begin, self._last = begin, source.read(begin, self._state.end - begin)
        if self._last[-8:] != _TAIL_MAGIC or self._last[-72:-8] != self._state.tail:
            raise corrupt(f"{source.name} does not end as its state says.")
        self._footer = _read_footer(self._piece(self._state.footer, self._state.footer_bytes, self._state.footer_sum))
        self._sections = _read_sections(self._footer, self._data_end, self._state.footer)
        self.summary = _read_summary(self._footer, self._lattice)
        if self.summary.cells != count:
            raise corrupt("The archive's head and footer do not agree.")
        self._rows = _read_directory(root, _HEAD_BYTES if not has_leaves else self._records_end,
                                     self._records_end if not has_leaves else self._data_end, has_leaves)
        self._has_leaves = has_leaves
        self._leaves: dict[int, list[_Row]] = {}

    def __enter__(self) -> "Archive":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._source.close()

    @cached_property
    def cells(self) -> tuple[ArchivedCell, ...]:
        """All CELLs by increasing id."""
        return _read_cells(self._section(_CELLS), self.summary.sessions)

    @cached_property
    def pose_graph(self) -> PoseGraph:
        """The newest poses and constraints."""
        graph = read_pose_graph(self._section(_POSE_GRAPH))
        if _CHANGES in self._sections:
            graph = read_changes(self._section(_CHANGES)).applied_to(graph)
        return graph

    @cached_property
    def scans(self) -> tuple[ArchivedScans, ...]:
        """The scans of each CELL that was made of some, by increasing id: stamps and poses, not their points."""
        found = read_archived_scans(self._section(_SCANS), _MAX_SECTION)
        if sum(len(scans.stamps_ns) for scans in found) != self.summary.scans:
            raise corrupt("The archive's list of scans is not as long as its footer says.")
        return found

    def cell(self, ident: int) -> Cell:
        """Reads and decodes one CELL: one request, after one for its directory once for some thousand CELLs. Coded ones
        take some 0.1 ms a plane. Error("not-found")."""
        row = self._row(ident)
        record = self._read(row.begin, row.length)
        if len(record) < _RECORD_HEAD or record[:8] != _RECORD_MAGIC:
            raise corrupt(f"There is no record of CELL {ident} where the directory says.")
        cell, size, checksum, encoding, head_sum = unpack_at("<IIQII", record, 8)
        payload = record[_RECORD_HEAD:]
        if head_sum != _sum(record[:28]) & 0xFFFFFFFF or cell != ident or size != len(payload) or checksum != _sum(payload):
            raise corrupt(f"The record of CELL {ident} is damaged.")
        if _ENCODINGS.get(encoding) != self.summary.encoding:
            raise corrupt(f"The record of CELL {ident} has another encoding than the archive.")
        found = read_cell(decompressed(payload, 24 << 20, "CELL")) if encoding == 1 else read_coded_cell(payload)
        if found.lattice != self._lattice or found.bound_m != self.summary.bound_m:
            raise corrupt(f"CELL {ident} is not of the archive's lattice, or not of its bound.")
        return found

    def _row(self, ident: int) -> _Row:
        rows = self._rows
        if self._has_leaves:
            before = [i for i, row in enumerate(rows) if row.cell <= ident]
            rows = self._leaf(before[-1]) if before else []
        for row in rows:
            if row.cell == ident:
                return row
        raise Error("not-found", f"The archive has no CELL {ident}.")

    def _leaf(self, number: int) -> list[_Row]:
        if number not in self._leaves:
            row = self._rows[number]
            data = self._piece(row.begin, row.length, row.checksum or 0)
            # Where a leaf's first record begins is said by its own gaps, from the end of the leaf before.
            self._leaves[number] = _read_directory(data, _HEAD_BYTES, self._records_end, False)
        return self._leaves[number]

    def _section(self, kind: int) -> bytes:
        if kind not in self._sections:
            raise corrupt(f"The archive lacks its section {kind}.")
        offset, length, checksum = self._sections[kind]
        return decompressed(self._piece(offset, length, checksum), _MAX_SECTION, "archive's section")

    def _piece(self, offset: int, length: int, checksum: int) -> bytes:
        data = self._read(offset, length)
        if _sum(data) != checksum:
            raise corrupt(f"{self._source.name} is damaged between bytes {offset} and {offset + length}.")
        return data

    def _read(self, offset: int, length: int) -> bytes:
        if self._last_begin <= offset and offset + length <= self._state.end:
            begin = offset - self._last_begin
            data = self._last[begin:begin + length]
        else:
            data = self._source.read(offset, length)
        if len(data) != length:
            raise corrupt(f"{self._source.name} ends in the middle.")
        return data


def _read_head(first: bytes) -> tuple[Lattice, int, int, int, bytes, bool]:
    if len(first) < _FIRST_BYTES or first[:8] != _MAGIC:
        raise corrupt("This is no CELLmap archive: it does not begin as one.")
    version, kind, lattice_version, size, cells, records_end, data_end, root_bytes, flags, root_sum, head_sum = unpack_at(
        "<HBBIQQQIIQQ", first, 8)
    if version != 1:
        raise unsupported(f"The archive is of version {version}; this package reads version 1.")
    if head_sum != _sum(first[:56]):
        raise corrupt("The archive's head is damaged.")
    if root_bytes == 0 or not _HEAD_BYTES <= records_end <= data_end or root_bytes > 14_848 or flags > 1 or cells > MAX_CELLS:
        raise corrupt("The archive was not finished, or its head contradicts itself.")
    root = first[1536:1536 + root_bytes]
    if _sum(root) != root_sum:
        raise corrupt("The archive's root directory is damaged.")
    return lattice_of(kind, lattice_version, size), cells, records_end, data_end, root, bool(flags)


def _newest_state(first: bytes) -> _State:
    newest = _State()
    for at, parity in ((512, 0), (1024, 1)):  # even serials, odd serials
        raw = first[at:at + 64]
        serial, block, footer, footer_bytes, footer_sum, end, zero, checksum = unpack_at("<8Q", raw, 0)
        sound = checksum == _sum(raw[:56]) and zero == 0 and serial % 2 == parity and _HEAD_BYTES <= block <= footer
        if sound and serial > newest.serial and footer_bytes <= _MAX_FOOTER and footer + footer_bytes < end <= 1 << 42:
            newest = _State(serial, block, footer, footer_bytes, footer_sum, end, raw)
    if newest.serial == 0:
        raise corrupt("Neither of the archive's two states is whole.")
    return newest


def _read_footer(data: bytes) -> Table:
    return Buffer(data, b"CAFT", "archive's footer", _MAX_FOOTER, lambda size: 64 + size // 16).root()


def _read_sections(footer: Table, data_end: int, footer_at: int) -> dict[int, tuple[int, int, int]]:
    sections = {}
    for table in footer.tables(13):
        kind, offset, length = table.number(0, "<B"), table.number(1, "<Q"), table.number(2, "<Q")
        if offset < data_end or offset + length > footer_at or length > _MAX_SECTION:
            raise corrupt("A section of the archive lies outside of it.")
        if kind != _SUPERSEDED:
            sections[kind] = (offset, length, table.number(3, "<Q"))
    return sections


def _read_summary(footer: Table, lattice: Lattice) -> ArchiveSummary:
    if read_lattice(footer, 3) != lattice or footer.number(4, "<B") not in _ENCODINGS:
        raise corrupt("The archive's footer does not agree with its head.")
    sessions = tuple(table.required(table.text(0)) for table in footer.tables(11))
    georeference = footer.table(12)
    return ArchiveSummary(footer.required(footer.text(1)), footer.number(2, "<q"), lattice,
                          _ENCODINGS[footer.number(4, "<B")], footer.number(5, "<I") * 1e-6, footer.number(6, "<Q"),
                          footer.number(7, "<Q"), footer.number(8, "<Q"), footer.number(10, "<Q"), sessions,
                          None if georeference is None else read_georeference(georeference))


def _read_directory(frame: bytes, begin: int, limit: int, has_sums: bool) -> list[_Row]:
    """The rows of a directory whose first row's gap counts from ``begin``."""
    root = Buffer(decompressed(frame, 64 << 20, "archive's directory"), b"CADR", "archive's directory", 64 << 20).root()
    count = root.number(1, "<I")
    if count > MAX_CELLS:
        raise corrupt("The archive's directory has too many rows.")
    cells, gaps, lengths = (
        read_column(root.required(root.vector(i, "u1")).tobytes(), count, "The archive's directory") for i in (2, 3, 4))
    check_ids(cells, "The archive's directory")
    sums = root.vector(5, "<u8")
    if has_sums and (sums is None or len(sums) != count):
        raise corrupt("The archive's directory lacks the sums of its leaves.")
    rows, end = [], begin
    for i, (cell, gap, length) in enumerate(zip(cells.tolist(), gaps.tolist(), lengths.tolist())):
        at = end + 8 * gap
        if gap < 0 or length < 0 or at + length > limit:
            raise corrupt("The archive's directory points outside of it.")
        rows.append(_Row(cell, at, length, int(sums[i]) if has_sums and sums is not None else None))
        end = at + -(-length // 8) * 8
    return rows


def _read_cells(data: bytes, sessions: tuple[str, ...]) -> tuple[ArchivedCell, ...]:
    root = Buffer(data, b"CACL", "archive's list of CELLs", _MAX_SECTION).root()
    count = root.number(1, "<I")
    if count > MAX_CELLS:
        raise corrupt("The archive's list of CELLs is too long.")
    columns: list[NDArray[np.int64]] = [
        read_column(root.required(root.vector(i, "u1")).tobytes(), count, "The archive's list of CELLs")
        for i in (2, 4, 5, 6, 7)]
    hashes = root.required(root.vector(3, "V32"))
    if len(hashes) != count or (count and not 0 <= columns[1].min() <= columns[1].max() < len(sessions)):
        raise corrupt("The archive's list of CELLs does not fit its sessions.")
    return tuple(
        ArchivedCell(cell, name.tobytes().hex(), sessions[session], sequence, planes, size)
        for cell, name, session, sequence, planes, size in zip(
            columns[0].tolist(), hashes, *(column.tolist() for column in columns[1:])))


__all__ = ["Archive", "ArchivedCell", "ArchiveSummary", "open_archive"]
