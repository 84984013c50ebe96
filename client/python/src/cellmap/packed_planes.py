"""Planes to the last bit (FORMAT.md, "Packed planes")."""

import math
import struct

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .lattice import Lattice
from .prediction import LIMIT, UNIT, KnownPlanes, Vector, frames_of, neighbour_offsets, to_cell
from .range_decoder import INTEGER_MODELS, RangeDecoder

DISTANCES = 4 + 256
NORMALS = DISTANCES + 3 * INTEGER_MODELS
LASTS = NORMALS + 9 * INTEGER_MODELS
PACKED_MODELS = LASTS + 3 * INTEGER_MODELS
Patch = tuple[int, int, int]


def _float32(value: float) -> float:
    rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return rounded


def _read_float(decoder: RangeDecoder, models: int, expected: float) -> float:
    """A float as its place among all floats, counted from that of the expected one."""
    bits = struct.unpack("<I", struct.pack("<f", expected))[0]
    place = bits ^ 0xFFFFFFFF if bits >> 31 else bits | 0x80000000
    place = (place + decoder.integer(models, 32)) % 2**32
    bits = place & 0x7FFFFFFF if place >> 31 else place ^ 0xFFFFFFFF
    value: float = struct.unpack("<f", struct.pack("<I", bits))[0]
    return value


def _known_as(plane: tuple[float, ...], u: list[float]) -> Vector:
    distance, n = plane[0], plane[1:]
    along = ((n[0] * u[0] + n[1] * u[1]) + n[2] * u[2]) * distance
    if along == 0 or not math.isfinite(along):
        raise corrupt("A plane of the coded CELL does not face its origin.")
    scale = UNIT / along
    v = [x * scale for x in n]
    if not all(abs(x) < LIMIT for x in v):
        return 0, 0, 0
    return math.floor(v[0] + 0.5), math.floor(v[1] + 0.5), math.floor(v[2] + 0.5)


def read_packed_planes(decoder: RangeDecoder, lattice: Lattice, patches: list[Patch], frame: bytes | None,
                       known: KnownPlanes) -> NDArray[np.float32]:
    """(k, 4) the planes of a layer's patches (lattice index, sphere, point): of the frame, else of the stream."""
    axes, fixed = frames_of(lattice, np.array([index for index, _, _ in patches], dtype=np.intp))
    if frame is not None:
        planes = np.frombuffer(frame, np.uint8).reshape(16, -1).T.copy().view("<f4") if frame else np.zeros((0, 4))
        if len(planes) != len(patches):
            raise corrupt("The frame of a layer of the coded CELL does not hold its planes.")
        for row, (_, sphere, p) in enumerate(patches):
            known.add(sphere, p, _known_as(tuple(planes[row].tolist()), axes[row][0]), axes[row][0])
        return planes.astype(np.float32)
    offsets = [neighbour_offsets(sphere) for sphere in lattice.spheres]
    rows = []
    for row, (_, sphere, p) in enumerate(patches):
        expected = known.predict(sphere, p, offsets[sphere][p >> 8][p & 3], axes[row], fixed[row])
        plane = _read_plane(decoder, to_cell(expected.mean, fixed[row]), expected.mean[0], min(expected.agree, 2))
        known.add(sphere, p, _known_as(plane, axes[row][0]), axes[row][0])
        rows.append(plane)
    return np.array(rows, dtype=np.float32).reshape(-1, 4)


def _read_plane(decoder: RangeDecoder, m: Vector, w: int, e: int) -> tuple[float, ...]:
    size = math.sqrt(float(m[0]) * m[0] + float(m[1]) * m[1] + float(m[2]) * m[2])
    expected = [_float32(-float(v) / size) if size > 0 else 0.0 for v in m]
    axis = max(range(3), key=lambda i: (abs(m[i]), -i))
    distance = _read_float(decoder, DISTANCES + INTEGER_MODELS * e, UNIT / w)
    normal = [0.0, 0.0, 0.0]
    for i in range(3):
        if i != axis:
            normal[i] = _read_float(decoder, NORMALS + INTEGER_MODELS * (3 * i + e), expected[i])
    a, b = normal[(axis + 1) % 3], normal[(axis + 2) % 3]
    if not (abs(a) <= 2 and abs(b) <= 2):
        raise corrupt("A normal of the coded CELL is none.")
    rest = math.sqrt(max(0.0, (1 - a * a) - b * b))
    normal[axis] = _read_float(decoder, LASTS + INTEGER_MODELS * axis, math.copysign(rest, expected[axis]))
    return distance, *normal
