"""What the server answers in JSON (schema/openapi.yaml), as typed values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .pose_graph import Scores
from .poses import Pose, pose_of_vector

Document = Mapping[str, Any]
T = TypeVar("T")


@dataclass(frozen=True)
class MapSummary:
    """A map as it stands."""

    name: str
    lattice: Mapping[str, Any]  #: {"kind": "fibonacci", "size": 50000}
    revision: int
    created: str  #: RFC 3339
    cells: int
    planes: int
    constraints: int
    encoded_bytes: int  #: of all CELLs as FlatBuffers
    stored_bytes: int  #: as the store keeps them
    scans: int
    raw_points: int
    raw_bytes: int
    bounds: Mapping[str, list[float]] | None  #: {"min": [x, y, z], "max": ...} of the CELLs' positions, metres
    sessions: list[str]


@dataclass(frozen=True, eq=False)
class CellSummary:
    id: int
    hash: str
    added: int  #: revision that brought it
    moved: int  #: revision that last changed its pose
    T_map_cell: Pose = field(repr=False)  #: (4, 4)
    session: str
    sequence: int
    planes: int
    bytes: int  #: of its FlatBuffers form


@dataclass(frozen=True, eq=False)
class Session:
    """One drive in a map."""

    name: str
    robot: str
    sensor: str
    odometry_frame: str
    started: str | None
    cells: int
    planes: int
    encoded_bytes: int
    aligned: bool  #: its poses are in the map frame
    last_cell: int | None
    T_map_odom: Pose | None = field(repr=False)  #: (4, 4); None while not aligned


@dataclass(frozen=True)
class Job:
    """A long-running operation of the server."""

    id: int
    map: str
    kind: str  #: "ingest" or "merge"
    state: str  #: "queued", "running", "succeeded", "failed" or "cancelled"
    session: str | None
    scans_done: int
    scans_total: int  #: 0 where it is not known
    cells_done: int
    progress: float | None  #: 0 to 1
    scans_per_second: float
    eta_s: float | None
    next_scan: int | None  #: uploads: the scan that is expected next
    error: Mapping[str, str] | None  #: {"code": ..., "message": ...} of a failed one
    worker: str | None = None  #: which process carries it out, of any server over the store

    @property
    def ended(self) -> bool:
        return self.state in ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, eq=False)
class Place:
    """A place of the map where a scan may have been taken."""

    cell: int  #: the CELL that the scan was registered to
    T_map_scan: Pose = field(repr=False)  #: (4, 4)
    confidence: float  #: 0 to 1, that the pose is right
    scores: Scores
    accepted: bool


@dataclass(frozen=True, eq=False)
class Relocalisation:
    """Where a scan was taken. Not found is an answer: then ``T_map_scan`` and what belongs to it are None."""

    found: bool
    T_map_scan: Pose | None  #: (4, 4)
    covariance: NDArray[np.float64] | None = field(repr=False)  #: (6, 6) of exp(xi) T_map_scan, translation first: m, rad
    cell: int | None
    confidence: float
    degenerate: bool  #: the scene does not hold every direction of motion
    alternatives: tuple[Place, ...]  #: other places that were tried
    cells_considered: int
    revision: int
    time_ms: float


def read(kind: type[T], document: Document, **named: Any) -> T:
    """The dataclass of a document; fields that it does not name are left out. Error("corrupt-data")."""
    values = {f.name: document[f.name] for f in fields(kind) if f.name in document}
    try:
        return kind(**{**values, **named})
    except TypeError as error:
        raise corrupt(f"The server's answer lacks something: {error}.") from None


def read_cell_summary(document: Document) -> CellSummary:
    return read(CellSummary, document, T_map_cell=pose_of_vector(document["pose"]))


def read_session(document: Document) -> Session:
    pose = document.get("T_map_odom")
    return read(Session, document, T_map_odom=None if pose is None else pose_of_vector(pose))


def read_relocalisation(document: Document) -> Relocalisation:
    found = bool(document["found"])
    return read(
        Relocalisation, document,
        T_map_scan=pose_of_vector(document["T_map_scan"]) if found else None,
        covariance=symmetric6(document["covariance"]) if found else None,
        cell=document["cell"]["id"] if found else None,
        confidence=document["confidence"] if found else 0.0,
        degenerate=bool(document.get("degenerate", False)),
        alternatives=tuple(
            Place(p["cell"]["id"], pose_of_vector(p["T_map_scan"]), p["confidence"], read(Scores, p["scores"]), p["accepted"])
            for p in document["alternatives"]))


def symmetric6(triangle: list[float]) -> NDArray[np.float64]:
    """The (6, 6) matrix of its upper triangle by rows, 21 numbers."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = triangle
    return np.triu(matrix) + np.triu(matrix, 1).T
