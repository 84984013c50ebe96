"""A CELLmap server from Python."""

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import quote, urlencode

import numpy as np
import zstandard
from numpy.typing import NDArray

from .cell import Cell, read_batch, read_cell
from .changes import Changes, read_changes
from .coded_cell import read_coded_cell
from .documents import (CellSummary, Job, MapSummary, Relocalisation, Session, read, read_cell_summary,
                        read_relocalisation, read_session)
from .errors import Error, invalid
from .pose_graph import PoseGraph, read_pose_graph
from .poses import Pose, pose_of_rows, vector_of_pose
from .scan import Scan
from .transport import Transport

_CELL, _CODED = "application/vnd.cellmap.cell", "application/vnd.cellmap.coded-cell"
_SCAN = "application/vnd.cellmap.scan"
_BATCH = 64
#: Relocalisation, loops and archives may keep a server busy for longer than other requests.
_LONG_S = 120.0


def _map(name: str, *rest: object) -> str:
    parts = "".join(f"/{quote(str(part), safe=':')}" for part in rest)
    return f"/v1/maps/{quote(name, safe='')}{parts}"


class Client:
    """All of a server's maps. Thread-safe: requests of several threads go one after another over one connection.

    Every method raises ``Error`` with the server's code: "not-found" for a map, CELL or job that is not there,
    "unavailable" where the server does not answer or is overloaded, "unauthenticated" or "permission-denied" where
    the token does not do. Poses are (4, 4) float64 arrays ``T_target_source``, lengths metres.
    """

    def __init__(self, url: str, token: str | None = None, *, timeout_s: float = 30.0) -> None:
        """``url`` such as ``http://127.0.0.1:8080``; ``token`` is sent as a bearer token. Connects when first asked."""
        self._transport = Transport(url, token, timeout_s)

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._transport.close()

    # --- Maps ---------------------------------------------------------------------------------------------

    def maps(self) -> list[MapSummary]:
        """All maps by name."""
        return [read(MapSummary, document) for document in self._json("GET", "/v1/maps")["maps"]]

    def map(self, name: str) -> MapSummary:
        return read(MapSummary, self._json("GET", _map(name)))

    def create_map(self, name: str, lattice_size: int = 50_000) -> MapSummary:
        """An empty map. Error("already-exists")."""
        lattice = {"kind": "fibonacci", "size": lattice_size}
        return read(MapSummary, self._json("POST", "/v1/maps", {"name": name, "lattice": lattice}))

    def delete_map(self, name: str) -> None:
        """With all that is in it. Error("conflict") while a job works on it."""
        self._transport.request("DELETE", _map(name), timeout_s=_LONG_S)

    def sessions(self, name: str) -> list[Session]:
        """The drives in a map, by name."""
        return [read_session(document) for document in self._json("GET", _map(name, "sessions"))["sessions"]]

    def comparison(self, name: str) -> dict[str, Any]:
        """The map representations that were compared for this map, as ``cellmap compare`` kept them."""
        return self._json("GET", _map(name, "comparison"))

    # --- CELLs --------------------------------------------------------------------------------------------

    def cells(self, name: str, *, near: Sequence[float] | None = None, radius_m: float | None = None,
              session: str | None = None, since: int | None = None) -> list[CellSummary]:
        """Which CELLs a map has and where; nearest first with ``near`` (x, y, z in the map frame) and ``radius_m``.

        ``since``: only those added or moved after this revision.
        """
        query = {"near": None if near is None else ",".join(map(repr, map(float, near))), "radius": radius_m,
                 "session": session, "since": since, "limit": 10_000}
        found: list[CellSummary] = []
        cursor: str | None = None
        while True:
            page = self._json("GET", _map(name, "cells") + _query({**query, "cursor": cursor}))
            found += [read_cell_summary(document) for document in page["cells"]]
            cursor = page["next_cursor"]
            if cursor is None:
                return found

    def cell(self, name: str, cell: int, *, bound_m: float | None = None) -> Cell:
        """One CELL. With ``bound_m`` (0.001 to 1) in a tenth of the bytes, its planes within that bound; decoding
        then takes some 0.1 ms a plane."""
        coded = f"{_CODED};encoding=compact;bound={bound_m}"
        answer = self._transport.request("GET", _map(name, "cells", cell), headers={
            "Accept": _CELL if bound_m is None else coded, "Accept-Encoding": "zstd"})
        return read_cell(answer.body) if bound_m is None else read_coded_cell(answer.body)

    def load_cells(self, name: str, cells: Iterable[int] | None = None) -> Iterator[tuple[int, Cell]]:
        """(id, CELL) of all CELLs of a map, or of those asked for, by increasing id, a batch of 64 at a time."""
        ids = sorted(set(cells) if cells is not None else {summary.id for summary in self.cells(name)})
        while ids:
            asked = {"ids": ids[:_BATCH], "limit": _BATCH}
            answer = self._transport.request(
                "POST", _map(name, "cells:batch"), json.dumps(asked).encode(),
                {"Content-Type": "application/json", "Accept": "application/vnd.cellmap.cells"})
            entries = read_batch(answer.body)
            if not entries:
                raise Error("not-found", f"The map {name!r} has no CELL {ids[0]}.")
            for ident, data in entries:
                yield ident, read_cell(data)
            ids = [ident for ident in ids if ident > entries[-1][0]]

    def put_cell(self, name: str, cell: int, content: Cell | bytes, T_map_cell: Pose | None = None) -> CellSummary:
        """Adds a CELL under a number; the same bytes again do nothing. Error("conflict") where another has it."""
        headers = {"Content-Type": _CELL}
        if T_map_cell is not None:
            headers["CELLmap-Pose"] = " ".join(repr(float(x)) for x in vector_of_pose(T_map_cell))
        body = content.to_bytes() if isinstance(content, Cell) else content
        answer = self._transport.request("PUT", _map(name, "cells", cell), body, headers)
        return read_cell_summary(answer.json())

    # --- Poses --------------------------------------------------------------------------------------------

    def pose_graph(self, name: str, revision: int | None = None) -> PoseGraph:
        """Poses and constraints, now or at an earlier revision."""
        return read_pose_graph(self._get(_map(name, "pose-graph") + _query({"revision": revision}),
                                         "application/vnd.cellmap.pose-graph"))

    def changes(self, name: str, since: int, *, wait_s: float = 0.0) -> Changes:
        """What changed after a revision. With ``wait_s`` (up to 60) the server waits so long for a change."""
        path = _map(name, "changes") + _query({"since": since, "wait_s": wait_s or None})
        return read_changes(self._get(path, "application/vnd.cellmap.changes", wait_s))

    def revisions(self, name: str) -> Iterator[int]:
        """The map's revision now, and every time it changes, until the map or the server goes."""
        for event, data in self._transport.follow(_map(name, "events")):
            if event == "revision":
                yield int(json.loads(data)["revision"])

    def trajectory(self, name: str, session: str, *,
                   odometry: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) stamps in seconds and (n, 4, 4) T_map_sensor of every scan; with ``odometry`` T_odom_sensor as it came in."""
        stage = "odometry" if odometry else "corrected"
        text = {format: self._get(_map(name, "trajectory") + _query({"session": session, "format": format, "stage": stage}),
                                  "text/plain").decode() for format in ("tum", "kitti")}
        stamps = np.array([float(line.split()[0]) for line in text["tum"].splitlines() if not line.startswith("#")])
        rows = [np.array(line.split(), dtype=np.float64) for line in text["kitti"].splitlines()]
        return stamps, np.array([pose_of_rows(row) for row in rows]).reshape(-1, 4, 4)

    # --- Relocalisation and loops -------------------------------------------------------------------------

    def relocalise(self, name: str, points: NDArray[np.floating[Any]] | Scan | Cell, *, prior: Pose | None = None,
                   radius_m: float | None = None, yaw_range_deg: float | None = None) -> Relocalisation:
        """Where in the map were these points seen? ``points``: (n, 3) or (n, 4), metres, sensor frame.

        A Cell, built of several scans, is found more surely than one scan. ``prior`` is a guess of T_map_scan, with
        ``radius_m`` (10) and ``yaw_range_deg`` (20) around it. Not found is an answer, not an error.
        """
        if isinstance(points, Scan):
            kind, body = _SCAN, points.to_bytes()
        elif isinstance(points, Cell):
            kind, body = _CELL, points.to_bytes()
        else:
            kind, body = "application/octet-stream", _kitti_bytes(points)
        query = {"prior": None if prior is None else ",".join(repr(float(x)) for x in vector_of_pose(prior)),
                 "radius": radius_m, "yaw_range_deg": yaw_range_deg}
        answer = self._transport.request("POST", _map(name, "relocalise") + _query(query), body, {"Content-Type": kind},
                                         _LONG_S)
        return read_relocalisation(answer.json())

    def explain_loop(self, name: str, loop: int) -> dict[str, Any]:
        """A loop with its evidence and how it stands at the poses of now (``LoopExplanation``)."""
        return self._json("GET", _map(name, "loops", loop))

    def pin_loop(self, name: str, loop: int, pinned: bool = True) -> dict[str, Any]:
        """Holds a loop for certain, or no longer; all loops are judged anew."""
        return self._json("PATCH", _map(name, "loops", loop), {"pinned": pinned}, _LONG_S)

    def delete_loop(self, name: str, loop: int) -> int:
        """Takes a loop back; the map is optimised without it. Returns the new revision."""
        return int(self._json("DELETE", _map(name, "loops", loop), timeout_s=_LONG_S)["revision"])

    def add_loop(self, name: str, from_cell: int, to_cell: int, T_from_to: Pose) -> dict[str, Any]:
        """Adds a loop that was measured elsewhere; the map is optimised with it (``LoopAnswer``)."""
        document = {"from": from_cell, "to": to_cell, "pose": vector_of_pose(T_from_to).tolist()}
        return self._json("POST", _map(name, "loops"), document, _LONG_S)

    # --- Mapping ------------------------------------------------------------------------------------------

    def ingest(self, name: str, path: str, *, session: str | None = None, poses: str | None = None,
               create_map: bool = True, options: dict[str, Any] | None = None) -> Job:
        """Starts to map a drive that lies on the server, below one of its data roots. ``follow`` it for its progress.

        ``options``: ``IngestOptions`` of the API, for example ``{"cell_distance_m": 6}``.
        """
        document = {"kind": "ingest", "path": path, "session": session, "poses": poses, "create_map": create_map,
                    "options": options}
        return self._start(name, document)

    def upload(self, name: str, session: str, scans: Iterable[Scan], *, create_map: bool = True,
               options: dict[str, Any] | None = None, on_progress: Callable[[Job], None] | None = None) -> Job:
        """Sends a drive's scans, in order from index 0, and waits for the map. Returns the job when it has succeeded.

        Waits where the server is busy. Scans that the server has already are skipped, so that a broken upload goes on.
        Error with the job's code where mapping fails.
        """
        document = {"kind": "ingest", "upload": True, "session": session, "create_map": create_map, "options": options}
        job = self._start(name, document)
        for scan in scans:
            if job.next_scan is not None and scan.index >= job.next_scan:
                self._put_scan(job.id, scan)
            if on_progress is not None and scan.index % 50 == 49:
                on_progress(self.job(job.id))
        self._transport.request("POST", f"/v1/jobs/{job.id}/complete", b"")
        return self.wait(job.id, on_progress)

    def jobs(self, name: str) -> list[Job]:
        """Of a map, oldest first."""
        return [read(Job, document) for document in self._json("GET", _map(name, "jobs"))["jobs"]]

    def job(self, job: int) -> Job:
        return read(Job, self._json("GET", f"/v1/jobs/{job}"))

    def cancel(self, job: int) -> Job:
        """Whole CELLs stay in the map."""
        return read(Job, self._json("DELETE", f"/v1/jobs/{job}"))

    def follow(self, job: int) -> Iterator[Job]:
        """The job as it goes on, at most ten times a second; the last one has ended."""
        for _, data in self._transport.follow(f"/v1/jobs/{job}/events"):
            yield read(Job, json.loads(data))

    def wait(self, job: int, on_progress: Callable[[Job], None] | None = None) -> Job:
        """The job when it has succeeded; Error with its code where it failed or was cancelled."""
        last = self.job(job)
        while not last.ended:
            for last in self.follow(job):
                if on_progress is not None:
                    on_progress(last)
            last = self.job(job)
        if last.state != "succeeded":
            error = last.error or {"code": last.state, "message": f"Job {job} was {last.state}."}
            raise Error(error["code"], error["message"])
        return last

    # --- Archives -----------------------------------------------------------------------------------------

    def save_archive(self, name: str, path: str | Path, *, bound_m: float | None = None) -> None:
        """The whole map as one file, every bit of it; with ``bound_m`` compact, planes within that bound."""
        query: dict[str, object] = {"encoding": "packed"}
        if bound_m is not None:
            query = {"encoding": "compact", "bound": bound_m}
        with open(path, "wb") as file:
            self._transport.download(_map(name, "archive") + _query(query), file, _LONG_S)

    def restore_archive(self, name: str, path: str | Path) -> MapSummary:
        """Makes a map of an archive; the name must be free."""
        headers = {"Content-Type": "application/vnd.cellmap.archive"}
        with open(path, "rb") as file:
            answer = self._transport.request("PUT", _map(name, "archive"), file, headers, _LONG_S)
        return read(MapSummary, answer.json())

    # --- Requests -----------------------------------------------------------------------------------------

    def _json(self, method: str, path: str, document: dict[str, Any] | None = None,
              timeout_s: float | None = None) -> dict[str, Any]:
        body = None if document is None else json.dumps(document).encode()
        headers = {"Accept": "application/json", **({"Content-Type": "application/json"} if body else {})}
        return self._transport.request(method, path, body, headers, timeout_s).json()

    def _get(self, path: str, accept: str, wait_s: float = 0.0) -> bytes:
        timeout_s = None if wait_s == 0 else wait_s + 10
        return self._transport.request("GET", path, headers={"Accept": accept, "Accept-Encoding": "zstd"},
                                       timeout_s=timeout_s).body

    def _start(self, name: str, document: dict[str, Any]) -> Job:
        asked = {key: value for key, value in document.items() if value is not None}
        return read(Job, self._json("POST", _map(name, "jobs"), asked))

    def _put_scan(self, job: int, scan: Scan) -> None:
        body = zstandard.ZstdCompressor(level=1).compress(scan.to_bytes())
        headers = {"Content-Type": _SCAN, "Content-Encoding": "zstd"}
        while True:
            try:
                self._transport.request("PUT", f"/v1/jobs/{job}/scans/{scan.index}", body, headers)
                return
            except Error as error:
                if error.status != 503:
                    raise
                time.sleep(0.2)  # its queue is full


def _query(values: Mapping[str, object]) -> str:
    given = {key: value for key, value in values.items() if value is not None}
    return f"?{urlencode(given)}" if given else ""


def _kitti_bytes(points: NDArray[np.floating[Any]]) -> bytes:
    """x, y, z, intensity as little-endian float32, as KITTI stores them."""
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] not in (3, 4) or len(points) > 2_000_000:
        raise invalid(f"Expected an (n, 3) or (n, 4) array of at most 2,000,000 points, found {points.shape}.")
    rows = np.zeros((len(points), 4), dtype="<f4")
    rows[:, :points.shape[1]] = points
    return rows.tobytes()
