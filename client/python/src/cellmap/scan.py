"""A sweep with its odometry pose on its way to a server (FORMAT.md, "Scan")."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt, invalid
from .flatbuffer import Buffer, Builder
from .poses import Pose, checked_pose
from .wire import pose_bytes, read_pose

MAX_POINTS = 2_000_000
MAX_BYTES = 24_004_096


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep."""

    index: int  #: position in the drive, from 0
    stamp_ns: int
    T_odom_sensor: Pose = field(repr=False)  #: (4, 4)
    points: NDArray[np.float32] = field(repr=False)  #: (n, 3) metres, sensor frame; NaN and infinity are allowed

    def to_bytes(self) -> bytes:
        points = np.asarray(self.points, dtype="<f4")
        if points.ndim != 2 or points.shape[1] < 3 or len(points) > MAX_POINTS:
            raise invalid(f"A scan is an (n, 3) array of at most {MAX_POINTS} points, found {points.shape}.")
        b = Builder()
        axes = [b.vector(np.ascontiguousarray(points[:, i]).tobytes(), len(points), 4) for i in range(3)]
        pose = pose_bytes(checked_pose(self.T_odom_sensor, "The scan's pose"))
        root = b.table({0: ("H", 1), 1: ("Q", self.index), 2: ("q", self.stamp_ns), 3: ("struct", pose),
                        4: ("ref", axes[0]), 5: ("ref", axes[1]), 6: ("ref", axes[2])})
        return b.finish(root, b"CSCN")


def read_scan(data: bytes) -> Scan:
    """Reads and checks a scan's bytes. Error("corrupt-data" or "unsupported")."""
    root = Buffer(data, b"CSCN", "scan", MAX_BYTES).root()
    axes = [root.required(root.vector(i, "<f4")) for i in (4, 5, 6)]
    if len({len(axis) for axis in axes}) != 1 or len(axes[0]) > MAX_POINTS:
        raise corrupt("The scan's coordinates are not equally long, or too many.")
    return Scan(root.number(1, "<Q"), root.number(2, "<q"), read_pose(root, 3, "The scan's pose"), np.stack(axes, axis=1))


def read_kitti(path: str) -> NDArray[np.float32]:
    """The (n, 4) points of a KITTI ``.bin`` file: x, y, z in metres, sensor frame, and the intensity."""
    values = np.fromfile(path, dtype="<f4")
    if len(values) % 4 != 0:
        raise corrupt(f"{path} is no KITTI scan: its bytes are not whole points of 16.")
    return values.reshape(-1, 4)
