"""Where the CELLs of a map are, and what is known between them (FORMAT.md, "Pose graph")."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .flatbuffer import Buffer, Table
from .poses import Pose, checked_pose, pose_of_rows
from .wire import check_ids, read_pose

MAX_BYTES = 512 << 20
KINDS = {1: "odometry", 2: "bidirectional", 3: "loop"}
ORIGINS = {1: "mapper", 2: "detection", 3: "user"}


@dataclass(frozen=True)
class Scores:
    """How well points agree with a CELL's planes; all zero where nothing was registered."""

    points: int = 0
    hits: int = 0  #: points that met a plane
    inlier_ratio_all: float = 0.0
    inlier_ratio_hit: float = 0.0
    share_in_front: float = 0.0
    share_beyond: float = 0.0
    median_residual_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Constraint:
    """A measured relative pose of two CELLs."""

    id: int
    from_cell: int
    to_cell: int
    kind: str  #: "odometry", "bidirectional" or "loop"
    origin: str  #: "mapper", "detection" or "user"
    T_from_to: Pose = field(repr=False)  #: (4, 4)
    information: NDArray[np.float64] = field(repr=False)  #: (6, 6) of exp(xi) T_from_to, translation first
    scores: Scores
    weight: float  #: what the last optimisation left of it: 0 rejected to 1
    pinned: bool  #: held by a user, never loses weight


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """A map at one revision."""

    revision: int
    cells: NDArray[np.uint32]  #: (n,) ids, strictly increasing
    T_map_cell: NDArray[np.float64] = field(repr=False)  #: (n, 4, 4) where each CELL is
    constraints: tuple[Constraint, ...] = field(repr=False)
    unaligned: NDArray[np.uint32] = field(repr=False)  #: ids of CELLs that are not in the map frame yet

    def pose(self, cell: int) -> Pose:
        """(4, 4) T_map_cell; KeyError where the graph has no such CELL."""
        at = int(np.searchsorted(self.cells, cell))
        if at == len(self.cells) or self.cells[at] != cell:
            raise KeyError(cell)
        pose: Pose = self.T_map_cell[at]
        return pose

    @property
    def loops(self) -> list[Constraint]:
        return [constraint for constraint in self.constraints if constraint.kind == "loop"]

    def residuals(self, kind: str = "loop") -> NDArray[np.float64]:
        """(k, 2) how far each constraint of a kind is from the present poses: metres, degrees."""
        rows = []
        for c in self.constraints:
            if c.kind != kind:
                continue
            error = np.linalg.inv(c.T_from_to) @ np.linalg.inv(self.pose(c.from_cell)) @ self.pose(c.to_cell)
            cosine = np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)
            rows.append([np.linalg.norm(error[:3, 3]), np.degrees(np.arccos(cosine))])
        return np.array(rows, dtype=np.float64).reshape(-1, 2)


def read_constraint(table: Table) -> Constraint:
    kind, origin = table.number(3, "<B"), table.number(4, "<B")
    if kind not in KINDS or origin not in ORIGINS:
        raise corrupt(f"A constraint is of kind {kind} and origin {origin}, which are not known.")
    triangle = np.frombuffer(table.required(table.struct(6, 168)), "<f8")
    information = np.zeros((6, 6))
    information[np.triu_indices(6)] = triangle
    information = np.triu(information) + np.triu(information, 1).T
    eigenvalues = np.linalg.eigvalsh(information) if np.isfinite(triangle).all() else np.array([-np.inf])
    if eigenvalues[0] < -1e-6 * np.abs(triangle).max() or not np.trace(information) > 0:
        raise corrupt("A constraint's information matrix is not positive semi-definite.")
    raw = table.struct(7, 48)
    scores = Scores()
    if raw is not None:
        counts, shares = np.frombuffer(raw, "<u4", 2), np.frombuffer(raw, "<f8", 5, 8)
        scores = Scores(int(counts[0]), int(counts[1]), *(float(share) for share in shares))
    return Constraint(table.number(0, "<I"), table.number(1, "<I"), table.number(2, "<I"), KINDS[kind], ORIGINS[origin],
                      read_pose(table, 5, "A constraint's pose"), information, scores, checked_weight(table.double(8, 1.0)),
                      table.number(9, "<B") != 0)


def checked_weight(weight: float) -> float:
    if not 0 <= weight <= 1:
        raise corrupt(f"A constraint's weight is {weight}, expected 0 to 1.")
    return weight


def read_pose_graph(data: bytes) -> PoseGraph:
    """Reads and checks a pose graph's bytes. Error("corrupt-data" or "unsupported")."""
    root = Buffer(data, b"CPGR", "pose graph", MAX_BYTES, lambda size: 64 + size // 256).root()
    nodes = root.required(root.vector(2, np.dtype([("cell", "<u4"), ("pad", "<u4"), ("pose", "<f8", 12)])))
    cells = np.ascontiguousarray(nodes["cell"]).astype(np.uint32)
    check_ids(cells.astype(np.int64), "The pose graph's nodes")
    poses = [checked_pose(pose_of_rows(rows), "A node's pose") for rows in nodes["pose"]]
    root.required(root.target(3))
    constraints = tuple(read_constraint(table) for table in root.tables(3))
    known = set(cells.tolist())
    for c in constraints:
        if c.from_cell == c.to_cell or c.from_cell not in known or c.to_cell not in known:
            raise corrupt(f"Constraint {c.id} does not tie two CELLs of the graph.")
    unaligned = root.vector(4, "<u4")
    unaligned = np.zeros(0, np.uint32) if unaligned is None else unaligned.astype(np.uint32)
    check_ids(unaligned.astype(np.int64), "The CELLs that are not aligned")
    return PoseGraph(root.number(1, "<Q"), cells, np.array(poses).reshape(-1, 4, 4), constraints, unaligned)


def judged(constraint: Constraint, weight: float, pinned: bool) -> Constraint:
    return replace(constraint, weight=weight, pinned=pinned)
