"""Poses: 4x4 float64 arrays ``T_target_source`` that map points, ``p_target = T_target_source @ p_source``."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt, invalid

Pose = NDArray[np.float64]


def pose_of_vector(vector: Sequence[float] | NDArray[np.float64]) -> Pose:
    """The (4, 4) pose of ``[x, y, z, qx, qy, qz, qw]``: metres, a unit quaternion."""
    values = np.asarray(vector, dtype=np.float64)
    if values.shape != (7,) or not np.isfinite(values).all():
        raise invalid("A pose is seven finite numbers: x, y, z, qx, qy, qz, qw.")
    norm = float(np.linalg.norm(values[3:]))
    if abs(norm - 1) > 1e-3:
        raise invalid(f"The pose's quaternion has length {norm:.6g}, expected 1.")
    x, y, z, w = values[3:] / norm
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = values[:3]
    return pose


def vector_of_pose(pose: Pose) -> NDArray[np.float64]:
    """The seven numbers ``[x, y, z, qx, qy, qz, qw]`` of a (4, 4) pose, qw >= 0."""
    pose = checked_pose(pose, "The pose")
    r = pose[:3, :3]
    # The largest of four ways (Shepperd), so that nothing small is divided by.
    squares = np.array([1 + 2 * r[i, i] - np.trace(r) for i in range(3)] + [1 + np.trace(r)])
    k = int(np.argmax(squares))
    q = np.empty(4)
    if k == 3:
        q[:] = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]]
    else:
        i, j, l = k, (k + 1) % 3, (k + 2) % 3
        q[[i, j, l, 3]] = [squares[i], r[j, i] + r[i, j], r[l, i] + r[i, l], r[l, j] - r[j, l]]
    q /= np.linalg.norm(q)
    return np.concatenate([pose[:3, 3], -q if q[3] < 0 else q])


def pose_of_rows(rows: NDArray[np.float64]) -> Pose:
    """The (4, 4) pose of the twelve numbers of ``[R | t]``, row by row."""
    pose = np.eye(4)
    pose[:3] = np.asarray(rows, dtype=np.float64).reshape(3, 4)
    return pose


def checked_pose(pose: Pose, what: str) -> Pose:
    """The pose where it is one (FORMAT.md, "Conventions"); Error("corrupt-data") where not."""
    pose = np.asarray(pose, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise corrupt(f"{what} is not a (4, 4) array of finite numbers.")
    r = pose[:3, :3]
    # Written so that NaN fails.
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = np.linalg.norm(r @ r.T - np.eye(3)) < 1e-6 and np.linalg.det(r) > 0
    if not rigid:
        raise corrupt(f"{what} does not turn rigidly.")
    return pose


def moved(points: NDArray[np.floating[Any]], pose: Pose) -> NDArray[np.float64]:
    """The (n, 3) points of the source frame in the target frame of ``T_target_source``."""
    mapped: NDArray[np.float64] = np.asarray(points, dtype=np.float64) @ pose[:3, :3].T + pose[:3, 3]
    return mapped
