"""CELLs in fewer bytes (FORMAT.md, "Coded CELL"). Decoding is plain Python: some 0.5 s for 6,000 planes."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .cell import MAX_BYTES, Cell, checked_cell, read_cell, read_lattice, read_origin
from .compact_planes import read_compact_planes
from .errors import corrupt, unsupported
from .first_probabilities import FIRST_PROBABILITIES
from .flatbuffer import Buffer, Table
from .lattice import Lattice
from .packed_planes import PACKED_MODELS, read_packed_planes
from .prediction import KnownPlanes, neighbour_offsets, reach
from .range_decoder import RangeDecoder
from .wire import check_content_hash, decompressed, field_at

PACKED, COMPACT_VERSIONS = 1, {2: 1, 3: 2}


@dataclass(frozen=True)
class _Head:
    """The fields of a coded CELL besides what it shares with a CELL."""

    root: Table
    lattice: Lattice
    encoding: int
    bound_um: int
    planes: int
    coarse_planes: int
    layers: tuple[bytes, bytes]
    data_begin: int


def is_coded(data: bytes) -> bool:
    return data[4:8] == b"CCOD"


def read_coded_cell(data: bytes) -> Cell:
    """Reads and checks a coded CELL. ``hash`` of the answer names the CELL that was coded.

    Of a packed one every bit is as it was; of a compact one ``bound_m`` says how far planes may be off.
    Error("corrupt-data" or "unsupported").
    """
    head = _read_head(data)
    root = head.root
    check_content_hash(data, root.required(root.struct(1, 32)), field_at(root, 1, 32), "coded CELL")
    if len(data) - root.vector_end(18) > 7 and head.layers != (b"", b""):
        raise corrupt("The coded CELL's data is not the last of the file.")
    _check_coarse_hash(data, head)
    cell = _decoded(head, 2)
    if head.encoding == PACKED and read_cell(cell.to_bytes()).hash != cell.hash:
        raise corrupt("The coded CELL does not decode to the CELL that it names.")
    return cell


def read_coarse_cell(beginning: bytes, file_bytes: int) -> Cell:
    """The coarse layer, a quarter of the planes, of the first bytes of a coded CELL of ``file_bytes`` bytes."""
    if not len(beginning) <= file_bytes <= MAX_BYTES:
        raise corrupt(f"{len(beginning)} bytes are no beginning of {file_bytes}.")
    head = _read_head(beginning + bytes(file_bytes - len(beginning)))
    if head.data_begin + len(head.layers[0]) > len(beginning):
        raise corrupt("The coarse layer of the coded CELL was cut off.")
    _check_coarse_hash(beginning, head)
    return _decoded(head, 1)


def _read_head(data: bytes) -> _Head:
    root = Buffer(data, b"CCOD", "coded CELL", MAX_BYTES).root()
    encoding, bound = root.number(4, "<B"), root.number(5, "<I")
    if encoding != PACKED and encoding not in COMPACT_VERSIONS:
        raise unsupported(f"Encoding {encoding} of a coded CELL is not known.")
    if bound != 0 if encoding == PACKED else not 1000 <= bound <= 1_000_000:
        raise corrupt(f"The coded CELL states a bound of {bound} micrometres.")
    lattice = read_lattice(root, 6)
    planes, coarse_planes, coarse_bytes = (root.number(i, "<I") for i in (7, 8, 9))
    layers = root.required(root.vector(18, "u1")).tobytes()
    if planes > lattice.count or coarse_planes > planes or coarse_bytes > len(layers):
        raise corrupt("The coded CELL's counts do not fit each other.")
    return _Head(root, lattice, encoding, bound, planes, coarse_planes, (layers[:coarse_bytes], layers[coarse_bytes:]),
                 root.vector_end(18) - len(layers))


def _check_coarse_hash(data: bytes, head: _Head) -> None:
    beginning = bytearray(data[:head.data_begin + len(head.layers[0])])
    if head.layers == (b"", b""):
        beginning = bytearray(data)
    for field in (1, 2):
        at = field_at(head.root, field, 32)
        if at + 32 > head.data_begin:
            raise corrupt("The coded CELL's data is not the last of the file.")
        beginning[at:at + 32] = bytes(32)
    if hashlib.sha256(beginning).digest() != head.root.struct(2, 32):
        raise corrupt("The coarse layer of the coded CELL is not what its hash says.")


def _decoded(head: _Head, layers: int) -> Cell:
    lattice, root = head.lattice, head.root
    known = KnownPlanes(lattice, fits=COMPACT_VERSIONS.get(head.encoding) == 2)
    have = [bytearray(sphere.size + 2 * reach(sphere)) for sphere in lattice.spheres]
    counts = (head.coarse_planes, head.planes - head.coarse_planes)
    parts = [_read_layer(head, layer, counts[layer], have, known) for layer in range(layers)]
    indices = np.concatenate([part[0] for part in parts])
    planes = np.concatenate([part[1] for part in parts])
    order = np.argsort(indices)
    name = root.required(root.struct(3, 32)).hex()
    cell = checked_cell(lattice, indices[order].astype(np.uint32), planes[order], read_origin(root, 10), name, 0.0)
    return replace(cell, bound_m=head.bound_um * 1e-6)


def _read_layer(head: _Head, layer: int, count: int, have: list[bytearray],
                known: KnownPlanes) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    data = head.layers[layer]
    version = COMPACT_VERSIONS.get(head.encoding)
    if version is not None:
        table = FIRST_PROBABILITIES[version]
        models = len(table) // 2
        decoder = RangeDecoder(data, table[layer * models:(layer + 1) * models])
        patches = list(_read_index(decoder, head.lattice, layer, count, have))
        planes = read_compact_planes(decoder, head.lattice, patches, head.bound_um, version, known)
    else:
        frame_bytes = RangeDecoder(data, b"").plain(32)
        if frame_bytes > len(data):
            raise corrupt("A layer of the coded CELL is shorter than its frame.")
        split = len(data) - frame_bytes
        decoder = RangeDecoder(data[:split], bytes([128]) * PACKED_MODELS)
        decoder.plain(32)
        patches = list(_read_index(decoder, head.lattice, layer, count, have))
        frame = decompressed(data[split:], 16 * count, "layer of the coded CELL") if frame_bytes > 0 else None
        planes = read_packed_planes(decoder, head.lattice, patches, frame, known)
    decoder.finish()
    return np.array([patch[0] for patch in patches], dtype=np.intp), planes


def _read_index(decoder: RangeDecoder, lattice: Lattice, layer: int, count: int,
                have: list[bytearray]) -> Iterator[tuple[int, int, int]]:
    """(lattice index, sphere, point) of each plane of a layer in order; marks them in ``have``."""
    found = 0
    for number, sphere in enumerate(lattice.spheres):
        offsets, margin, mine, before = neighbour_offsets(sphere), reach(sphere), have[number], 0
        points = sphere.points.tolist()
        for begin in range(0, len(points), 64):
            rows = points[begin:begin + 64]
            coarse = int(layer == 1 and any(mine[p + margin] for p in rows if p % 4 == 0))
            before = decoder.bit(2 * before + coarse)
            if not before:
                continue
            for k, p in enumerate(rows):
                if (p % 4 == 0) != (layer == 0):
                    continue
                at, context = p + margin, 0
                for offset in offsets[p >> 8][p & 3]:
                    context = context << 1 | mine[at + offset]
                if decoder.bit(4 + context):
                    mine[at] = 1
                    found += 1
                    if found > count:
                        raise corrupt("A layer of the coded CELL has more planes than it says.")
                    yield sphere.first + begin + k, number, p
    if found != count:
        raise corrupt(f"A layer of the coded CELL has {found} planes where it says {count}.")

