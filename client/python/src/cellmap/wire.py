"""What several kinds of file share: poses, hashes, columns, zstd frames."""

import hashlib
import struct

import numpy as np
import zstandard
from numpy.typing import NDArray

from .errors import corrupt
from .flatbuffer import Table
from .poses import Pose, checked_pose, pose_of_rows

SESSION_CHARACTERS = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-")


def read_pose(table: Table, field: int, what: str) -> Pose:
    rows = np.frombuffer(table.required(table.struct(field, 96)), "<f8")
    return checked_pose(pose_of_rows(rows), what)


def pose_bytes(pose: Pose) -> bytes:
    return np.ascontiguousarray(pose[:3], dtype="<f8").tobytes()


def read_session(table: Table, field: int) -> str:
    name = table.required(table.text(field))
    if not 1 <= len(name) <= 64 or not set(name) <= SESSION_CHARACTERS:
        raise corrupt("A session is named by 1 to 64 of the characters A-Z a-z 0-9 . _ -")
    return name


def check_content_hash(data: bytes, stated: bytes, field_at: int, what: str) -> str:
    """The content hash as text; Error("corrupt-data") where it is not that of these bytes."""
    blank = data[:field_at] + bytes(32) + data[field_at + 32:]
    if hashlib.sha256(blank).digest() != stated:
        raise corrupt(f"The {what} is not what its hash says: it was damaged or cut off.")
    return stated.hex()


def field_at(table: Table, field: int, size: int) -> int:
    return table.required(table.place(field, size))


def decompressed(frame: bytes, max_bytes: int, what: str) -> bytes:
    """The content of exactly one zstd frame that declares its size (FORMAT.md, "Compression")."""
    if frame[:4] != b"\x28\xb5\x2f\xfd":
        raise corrupt(f"The {what} is no zstd frame.")
    try:
        size = zstandard.frame_content_size(frame)
        if not 0 <= size <= max_bytes:
            raise corrupt(f"The {what} declares {size} bytes of content, at most {max_bytes} are allowed.")
        decoder = zstandard.ZstdDecompressor().decompressobj()
        content: bytes = decoder.decompress(frame)
    except zstandard.ZstdError as error:
        raise corrupt(f"The {what} cannot be decompressed: {error}.") from None
    if decoder.unused_data:
        raise corrupt(f"Bytes follow the zstd frame of the {what}.")
    if len(content) != size:
        raise corrupt(f"The {what} has {len(content)} bytes where {size} were declared.")
    return content


def read_column(data: bytes, count: int, what: str) -> NDArray[np.int64]:
    """The (count,) integers of a column (FORMAT.md, "Columns"), modulo 2^64 and read as signed."""
    if len(data) > 8 * count or (count == 0 and data) or (count > 0 and len(data) % count != 0):
        raise corrupt(f"{what}: {len(data)} bytes are no column of {count} numbers.")
    u = np.zeros(count, np.uint64)
    planes = np.frombuffer(data, np.uint8).reshape(-1, max(count, 1))
    for k, part in enumerate(planes):
        u |= part.astype(np.uint64) << np.uint64(8 * k)
    r = (u >> np.uint64(1)) ^ (np.uint64(0) - (u & np.uint64(1)))
    # r_1 has no step behind it, later ones are differences of steps: two sums undo both.
    steps = np.cumsum(r[1:], dtype=np.uint64)
    return np.cumsum(np.concatenate([r[:1], steps]), dtype=np.uint64).view(np.int64)


def read_ids(table: Table, what: str) -> NDArray[np.int64]:
    """A list of ids, ``{count, ids}``: strictly increasing, 0 to 2^32 - 1."""
    count = table.number(0, "<I")
    data = table.required(table.vector(1, "u1")).tobytes()
    if not 1 <= count <= 2_097_152 or (len(data) < count and count > 1):
        raise corrupt(f"{what}: {len(data)} bytes are no list of {count} ids.")
    ids = read_column(data, count, what)
    check_ids(ids, what)
    return ids


def check_ids(ids: NDArray[np.int64], what: str) -> None:
    if len(ids) and (ids[0] < 0 or ids[-1] >= 2**32 or (ids[1:] <= ids[:-1]).any()):
        raise corrupt(f"{what}: the ids are not strictly increasing numbers of 32 bits.")


def rotations_of_rodrigues(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3) rotations of (n, 3) modified Rodrigues parameters, bit by bit as FORMAT.md, "Changes", says."""
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    xx, yy, zz = x * x, y * y, z * z
    s = xx + yy + zz
    d = (1 + s) * (1 + s)
    c = 4 * (1 - s)
    rows = [
        [1 - 8 * (yy + zz) / d, (8 * x * y - c * z) / d, (8 * x * z + c * y) / d],
        [(8 * x * y + c * z) / d, 1 - 8 * (xx + zz) / d, (8 * y * z - c * x) / d],
        [(8 * x * z - c * y) / d, (8 * y * z + c * x) / d, 1 - 8 * (xx + yy) / d],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def poses_of_columns(columns: list[bytes], count: int, what: str) -> NDArray[np.float64]:
    """(count, 4, 4) poses of the six columns x y z rx ry rz."""
    values = [read_column(column, count, what) for column in columns]
    # Not by abs, which leaves the smallest number negative.
    if any(((v < -limit) | (v > limit)).any() for v, limit in zip(values, 3 * [2**37] + 3 * [2**22])):
        raise corrupt(f"{what}: a pose is out of range.")
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = np.stack([v * 2.0**-13 for v in values[:3]], axis=1)
    poses[:, :3, :3] = rotations_of_rodrigues(np.stack([v * 2.0**-22 for v in values[3:]], axis=1))
    return poses


def unpack_at(kind: str, data: bytes, at: int) -> tuple[int, ...]:
    try:
        return struct.unpack_from(kind, data, at)
    except struct.error:
        raise corrupt("The file ends in the middle.") from None

