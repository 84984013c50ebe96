"""Which scans an archive's CELLs were made of, and where the map lies on Earth (FORMAT.md, "Archive")."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .flatbuffer import Buffer, Table
from .poses import Pose, checked_pose, pose_of_rows
from .wire import check_ids, poses_of_columns, read_column, read_pose

MAX_CELLS, _MAX_SCANS_A_CELL, _MAX_SCANS, _MAX_COUNT = 1 << 20, 100_000, 1 << 24, 10**15
#: Columns of zeros have no bytes: only so many scans more than bytes are believed.
_SCANS_WITHOUT_BYTES = 1 << 16
_WHAT = "archive's list of scans"


@dataclass(frozen=True, eq=False)
class ArchivedScans:
    """The scans of one CELL, in the order of the drive."""

    cell: int
    raw_points: int  #: of all of them as they came
    voxel_points: int  #: of a voxel cloud of them, for comparison
    T_odom_cell: Pose = field(repr=False)  #: (4, 4)
    stamps_ns: NDArray[np.int64] = field(repr=False)  #: (n,)
    T_cell_scan: NDArray[np.float64] = field(repr=False)  #: (n, 4, 4)


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where on Earth the origin of the map frame lies, and how the frame is turned there."""

    latitude_deg: float
    longitude_deg: float
    height_m: float  #: above the WGS 84 ellipsoid
    R_enu_map: NDArray[np.float64] = field(repr=False)  #: (3, 3), to east, north and up


def read_archived_scans(data: bytes, max_bytes: int) -> tuple[ArchivedScans, ...]:
    """The table ``ArchiveScans`` of these bytes, by increasing CELL. Error("corrupt-data" or "unsupported")."""
    root = Buffer(data, b"CASC", _WHAT, max_bytes).root()
    count = root.number(1, "<I")
    if count > MAX_CELLS:
        raise corrupt(f"The {_WHAT} names {count} CELLs, at most {MAX_CELLS} are allowed.")
    cells = _column(root, 2, count)
    check_ids(cells, f"The {_WHAT}")
    counts, raw_points, voxel_points = (
        _bounded(_column(root, i, count), limit) for i, limit in ((3, _MAX_SCANS_A_CELL), (4, _MAX_COUNT), (5, _MAX_COUNT)))
    scans = int(counts.sum())
    if scans > min(_MAX_SCANS, _SCANS_WITHOUT_BYTES + len(data)):
        raise corrupt(f"The {_WHAT} names {scans} scans, more than its bytes can tell.")
    stamps = _column(root, 6, scans)
    poses = _poses(root, count + scans)
    ends = np.cumsum(counts).tolist()
    return tuple(
        ArchivedScans(cell, raw, voxel, poses[i], stamps[end - n:end], poses[count + end - n:count + end])
        for i, (cell, raw, voxel, n, end) in enumerate(
            zip(cells.tolist(), raw_points.tolist(), voxel_points.tolist(), counts.tolist(), ends)))


def read_georeference(table: Table) -> Georeference:
    """Of the table ``ArchiveGeoreference``. Error("corrupt-data")."""
    pose = read_pose(table, 3, "The archive's georeference")
    found = Georeference(table.double(0), table.double(1), table.double(2), pose[:3, :3])
    # Written so that NaN fails.
    if not (abs(found.latitude_deg) <= 90 and abs(found.longitude_deg) <= 180 and -10_000 <= found.height_m <= 100_000):
        raise corrupt("The archive's georeference is nowhere on Earth.")
    return found


def _column(root: Table, field_id: int, count: int) -> NDArray[np.int64]:
    return read_column(root.required(root.vector(field_id, "u1")).tobytes(), count, f"The {_WHAT}")


def _bounded(values: NDArray[np.int64], limit: int) -> NDArray[np.int64]:
    if len(values) and not 0 <= values.min() <= values.max() <= limit:
        raise corrupt(f"The {_WHAT} holds numbers out of range.")
    return values


def _poses(root: Table, count: int) -> NDArray[np.float64]:
    exact = root.vector(7, "V96")
    if exact is None:
        columns = [root.required(root.vector(i, "u1")).tobytes() for i in range(8, 14)]
        return poses_of_columns(columns, count, f"The {_WHAT}")
    if len(exact) != count:
        raise corrupt(f"The {_WHAT} has {len(exact)} poses for {count} CELLs and scans.")
    rows = np.frombuffer(exact.tobytes(), "<f8").reshape(count, 12)
    return np.array([checked_pose(pose_of_rows(row), "A scan's pose") for row in rows]).reshape(count, 4, 4)
