"""What leads from one revision of a map to another (FORMAT.md, "Changes")."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .documents import CellSummary
from .errors import corrupt, invalid
from .flatbuffer import Buffer, Table
from .pose_graph import Constraint, PoseGraph, checked_weight, judged, read_constraint
from .wire import poses_of_columns, read_ids, read_pose, read_session

MAX_BYTES = 512 << 20


@dataclass(frozen=True, eq=False)
class Changes:
    """A reader that has the map at ``since`` removes, then adds and moves, and has it at ``revision``."""

    since: int
    revision: int
    added: tuple[CellSummary, ...]
    moved: NDArray[np.int64]  #: (m,) ids of CELLs that were there and have another pose now
    T_map_moved: NDArray[np.float64] = field(repr=False)  #: (m, 4, 4) those poses, exact to 0.1 mm and 1e-6 rad
    removed: NDArray[np.int64]  #: ids
    added_constraints: tuple[Constraint, ...] = field(repr=False)
    removed_constraints: NDArray[np.int64] = field(repr=False)  #: ids
    unaligned: NDArray[np.int64] = field(repr=False)  #: ids of all CELLs that are not in the map frame at ``revision``
    judged: tuple[tuple[int, float, bool], ...] = field(repr=False)  #: (constraint, weight, pinned) judged anew

    def applied_to(self, graph: PoseGraph) -> PoseGraph:
        """The pose graph at ``revision``, of the one at ``since``. Error("invalid-argument") for another one."""
        if graph.revision != self.since:
            raise invalid(f"The changes lead from revision {self.since}, the graph is at {graph.revision}.")
        poses = dict(zip(graph.cells.tolist(), graph.T_map_cell))
        for cell in self.removed.tolist():
            poses.pop(cell, None)
        poses.update((cell.id, cell.T_map_cell) for cell in self.added)
        poses.update((cell, pose) for cell, pose in zip(self.moved.tolist(), self.T_map_moved) if cell in poses)
        constraints = {c.id: c for c in graph.constraints}
        for ident in self.removed_constraints.tolist():
            constraints.pop(ident, None)
        constraints.update((c.id, c) for c in self.added_constraints)
        for ident, weight, pinned in self.judged:
            if ident in constraints:
                constraints[ident] = judged(constraints[ident], weight, pinned)
        cells = sorted(poses)
        return PoseGraph(self.revision, np.array(cells, np.uint32), np.array([poses[c] for c in cells]).reshape(-1, 4, 4),
                         tuple(constraints[c] for c in sorted(constraints)), self.unaligned.astype(np.uint32))


def read_changes(data: bytes) -> Changes:
    """Reads and checks the bytes of changes. Error("corrupt-data" or "unsupported")."""
    root = Buffer(data, b"CCHG", "changes file", MAX_BYTES, lambda size: 64 + size // 128).root()
    since, revision = root.number(1, "<Q"), root.number(2, "<Q")
    if since > revision:
        raise corrupt(f"The changes lead back from revision {since} to {revision}.")
    root.required(root.target(3))
    root.required(root.target(6))
    moved, poses = _read_moved(root.table(4))
    return Changes(since, revision, tuple(_read_added(table) for table in root.tables(3)), moved, poses,
                   _ids(root, 5, "Removed CELLs"), tuple(read_constraint(table) for table in root.tables(6)),
                   _ids(root, 7, "Removed constraints"), _ids(root, 8, "CELLs that are not aligned"),
                   _read_judged(root.table(9)))


def _ids(root: Table, field_id: int, what: str) -> NDArray[np.int64]:
    table = root.table(field_id)
    return np.zeros(0, np.int64) if table is None else read_ids(table, what)


def _read_added(table: Table) -> CellSummary:
    return CellSummary(table.number(0, "<I"), table.required(table.struct(1, 32)).hex(), table.number(2, "<Q"),
                     table.number(3, "<Q"), read_pose(table, 4, "An added CELL's pose"), read_session(table, 5),
                     table.number(6, "<I"), table.number(7, "<I"), table.number(8, "<Q"))


def _read_moved(table: Table | None) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    if table is None:
        return np.zeros(0, np.int64), np.zeros((0, 4, 4))
    ids = read_ids(table.required(table.table(0)), "Moved CELLs")
    columns = [table.required(table.vector(i, "u1")).tobytes() for i in range(1, 7)]
    return ids, poses_of_columns(columns, len(ids), "Moved CELLs")


def _read_judged(table: Table | None) -> tuple[tuple[int, float, bool], ...]:
    if table is None:
        return ()
    ids = read_ids(table.required(table.table(0)), "Judged constraints")
    weights = table.required(table.vector(1, "<f8"))
    pinned = table.required(table.vector(2, "u1"))
    if len(weights) != len(ids) or len(pinned) != len(ids) or ids[0] < 1:
        raise corrupt("The judged constraints' columns do not fit each other.")
    return tuple((int(i), checked_weight(float(w)), bool(p)) for i, w, p in zip(ids, weights, pinned))
