"""A CELL: one plane in each direction of a lattice where a flat surface was seen (FORMAT.md, "CELL")."""

import hashlib
import struct
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .flatbuffer import Buffer, Builder, Table
from .lattice import Lattice, lattice_of
from .poses import Pose
from .wire import check_content_hash, field_at, pose_bytes, read_pose, read_session

MAX_BYTES = 25_165_824


@dataclass(frozen=True)
class Statistics:
    """How a CELL was made: counts of points, of patches hit, and of patches rejected by each test."""

    points: int = 0
    points_in_planes: int = 0
    patches_hit: int = 0
    rejected_few_points: int = 0
    rejected_gap: int = 0
    rejected_planarity: int = 0
    rejected_grazing: int = 0


@dataclass(frozen=True, eq=False)
class Cell:
    """A CELL never changes; its current pose is in the pose graph. Arrays are read-only."""

    lattice: Lattice
    indices: NDArray[np.uint32] = field(repr=False)  #: (n,) lattice points that have a plane, strictly increasing
    planes: NDArray[np.float32] = field(repr=False)  #: (n, 4) distance along the direction in metres, unit normal
    session: str  #: which drive it came from
    sequence: int  #: position within the session, from 0
    T_odom_cell: Pose = field(repr=False)  #: (4, 4) the odometry pose it was born at
    first_stamp_ns: int
    last_stamp_ns: int
    first_scan: int  #: index of the base scan in the drive
    scan_count: int  #: number of stacked scans
    statistics: Statistics
    hash: str  #: SHA-256 of its bytes, 64 hexadecimal digits: its name
    bound_m: float = 0.0  #: how far a point of a plane may be off, along the normal: of compact coded CELLs

    @property
    def normals(self) -> NDArray[np.float32]:
        """(n, 3) unit normals in the cell frame, towards the CELL's origin."""
        return self.planes[:, 1:]

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) the middle of each patch in the cell frame, metres: distance times direction."""
        return self.planes[:, :1] * self.lattice.directions[self.indices]

    def to_bytes(self) -> bytes:
        """The CELL as the library lays it out, to be put on a server. Its hash is ``hash`` unless another wrote it."""
        b, n = Builder(), len(self.indices)
        planes = b.vector(np.ascontiguousarray(self.planes, "<f4").tobytes(), n, 16)
        indices = b.vector(np.ascontiguousarray(self.indices, "<u4").tobytes(), n, 4)
        session = b.text(self.session)
        lattice = b.table({0: ("B", self.lattice.kind), 1: ("B", 1), 2: ("I", self.lattice.size)})
        s = self.statistics
        statistics = b.table({
            0: ("Q", s.points), 1: ("Q", s.points_in_planes), 2: ("I", s.patches_hit), 3: ("I", s.rejected_few_points),
            4: ("I", s.rejected_gap), 5: ("I", s.rejected_planarity), 6: ("I", s.rejected_grazing)})
        root = b.table({
            0: ("H", 1), 1: ("struct", bytes(32)), 2: ("ref", lattice), 3: ("ref", indices), 4: ("ref", planes),
            5: ("ref", session), 6: ("I", self.sequence), 7: ("struct", pose_bytes(self.T_odom_cell)),
            8: ("q", self.first_stamp_ns), 9: ("q", self.last_stamp_ns), 10: ("I", self.first_scan),
            11: ("I", self.scan_count), 12: ("ref", statistics)})
        blank = b.finish(root, b"CELL")
        at = field_at(Buffer(blank, b"CELL", "CELL", MAX_BYTES).root(), 1, 32)
        return blank[:at] + hashlib.sha256(blank).digest() + blank[at + 32:]


def read_cell(data: bytes) -> Cell:
    """Reads and checks a CELL's bytes. Error("corrupt-data" or "unsupported"). About 1 ms."""
    root = Buffer(data, b"CELL", "CELL", MAX_BYTES).root()
    name = check_content_hash(data, root.required(root.struct(1, 32)), field_at(root, 1, 32), "CELL")
    lattice = read_lattice(root, 2)
    indices = root.required(root.vector(3, "<u4"))
    planes = root.required(root.vector(4, "<f4,<f4,<f4,<f4")).view("<f4").reshape(-1, 4)
    return checked_cell(lattice, indices, planes, read_origin(root, 5), name, 0.0)


def read_lattice(root: Table, at: int) -> Lattice:
    table = root.required(root.table(at))
    return lattice_of(table.number(0, "<B"), table.number(1, "<B"), table.number(2, "<I"))


@dataclass(frozen=True)
class Origin:
    """The fields that a CELL and a coded CELL share."""

    session: str
    sequence: int
    T_odom_cell: Pose
    first_stamp_ns: int
    last_stamp_ns: int
    first_scan: int
    scan_count: int
    statistics: Statistics


def read_origin(root: Table, first: int) -> Origin:
    """Eight fields from ``first`` on: session to statistics."""
    begin, end = root.number(first + 3, "<q"), root.number(first + 4, "<q")
    if begin > end:
        raise corrupt("The CELL's first stamp is later than its last.")
    table = root.table(first + 7)
    counts = [] if table is None else [table.number(i, "<Q" if i < 2 else "<I") for i in range(7)]
    return Origin(read_session(root, first), root.number(first + 1, "<I"), read_pose(root, first + 2, "The CELL's pose"),
                  begin, end, root.number(first + 5, "<I"), root.number(first + 6, "<I"), Statistics(*counts))


def checked_cell(lattice: Lattice, indices: NDArray[np.uint32], planes: NDArray[np.float32], origin: Origin,
                 name: str, bound_m: float) -> Cell:
    """The CELL where every rule of FORMAT.md holds."""
    if len(planes) != len(indices):
        raise corrupt(f"The CELL has {len(indices)} lattice points but {len(planes)} planes.")
    if len(indices) and (indices[-1] >= lattice.count or (indices[1:] <= indices[:-1]).any()):
        raise corrupt("The CELL's lattice points are not strictly increasing, or not of its lattice.")
    distance, normals = planes[:, 0], planes[:, 1:].astype(np.float64)
    facing = np.einsum("ij,ij->i", normals, lattice.directions[indices])
    norm = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    # Written so that NaN fails.
    sound = (distance > 0) & (distance <= 10_000) & (np.abs(norm - 1) <= 1e-3) & (facing < 0)
    if not sound.all():
        raise corrupt(f"Plane {int(np.argmin(sound))} of the CELL is none.")
    indices.flags.writeable = planes.flags.writeable = False
    return Cell(lattice, indices, planes, **vars(origin), hash=name, bound_m=bound_m)


def read_batch(data: bytes) -> list[tuple[int, bytes]]:
    """(id, bytes) of each entry of a batch of CELLs."""
    entries, at = [], 0
    while at < len(data):
        if at + 8 > len(data):
            raise corrupt("A batch of CELLs ends in the middle.")
        ident, size = struct.unpack_from("<II", data, at)
        at += 8
        if at + size > len(data):
            raise corrupt("A batch of CELLs ends in the middle.")
        entries.append((ident, data[at:at + size]))
        at += size
    return entries
