"""What the conformance files hold, to the last bit."""

from typing import Any

import numpy as np
import pytest
from conftest import ROOT, VECTORS, twin

from cellmap import Error, lattice_of, read_cell, read_changes, read_coarse_cell, read_coded_cell, read_pose_graph, read_scan
from cellmap.first_probabilities import FIRST_PROBABILITIES
from cellmap.prediction import neighbour_offsets

KINDS = {"Fibonacci": 1, "FibonacciBands": 2}
CELLS = ["street", "empty", "largest-lattice", "released-lattice"]
CODED = ["room-packed", "room-10mm", "part-of-a-room-20mm", "bands-50mm", "bands-packed", "nothing-packed", "nothing-1mm",
         "room-10mm-2", "part-of-a-room-20mm-2", "bands-50mm-2", "nothing-1mm-2"]
GRAPHS = ["three-cells", "empty-map", "judged-loops"]
CHANGES = ["after-a-loop", "extremes", "beyond-half-a-turn", "no-changes", "judged-anew"]


def pose_of(document: dict[str, float]) -> np.ndarray:
    names = ["r00", "r01", "r02", "tx", "r10", "r11", "r12", "ty", "r20", "r21", "r22", "tz"]
    return np.array([document[name] for name in names] + [0, 0, 0, 1], dtype=np.float64).reshape(4, 4)


def planes_of(rows: list[Any]) -> np.ndarray:
    as_lists = [[r["distance"], r["nx"], r["ny"], r["nz"]] if isinstance(r, dict) else r for r in rows]
    return np.array(as_lists, dtype=np.float32).reshape(-1, 4)


@pytest.mark.parametrize("file", ["lattice-directions", "band-directions"])
def test_directions_are_those_of_the_format_to_the_last_bit(file: str) -> None:
    for row in twin(file):
        lattice = lattice_of(1 if row["kind"] == "fibonacci" else 2, 1, row["size"])
        assert lattice.directions[row["index"]].tolist() == row["direction"]
        assert lattice.count == row.get("count", row["size"])


@pytest.mark.parametrize("layout", [".cell", ".canonical.cell"])
@pytest.mark.parametrize("name", CELLS)
def test_cells_are_what_their_twins_say(name: str, layout: str) -> None:
    cell, expected = read_cell((VECTORS / (name + layout)).read_bytes()), twin(name)
    assert cell.indices.tolist() == expected["indices"]
    assert cell.planes.tobytes() == planes_of(expected["planes"]).tobytes()
    assert (cell.lattice.kind, cell.lattice.size) == (KINDS[expected["lattice"]["kind"]], expected["lattice"]["size"])
    assert np.array_equal(cell.T_odom_cell, pose_of(expected["t_odom_cell"]))
    for field in ("session", "sequence", "first_stamp_ns", "last_stamp_ns", "first_scan", "scan_count"):
        assert getattr(cell, field) == expected.get(field, 0)
    assert {k: v for k, v in vars(cell.statistics).items() if v} == {
        k: v for k, v in expected.get("statistics", {}).items() if v}


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_written_again_has_the_bytes_of_the_library(name: str) -> None:
    cell = read_cell((VECTORS / f"{name}.cell").read_bytes())
    assert cell.to_bytes() == (VECTORS / f"{name}.canonical.cell").read_bytes()


def test_points_lie_on_their_rays_and_planes() -> None:
    cell = read_cell((VECTORS / "street.cell").read_bytes())
    directions = cell.lattice.directions[cell.indices]
    assert np.allclose(np.linalg.norm(cell.points, axis=1), cell.planes[:, 0], rtol=1e-6)
    assert np.allclose(np.cross(cell.points, directions), 0, atol=1e-5)
    assert (np.einsum("ij,ij->i", cell.normals, directions) < 0).all()


@pytest.mark.parametrize("layout", [".ccod", ".canonical.ccod"])
@pytest.mark.parametrize("name", CODED)
def test_coded_cells_decode_to_what_their_twins_say(name: str, layout: str) -> None:
    expected = twin(name)
    cell = read_coded_cell((VECTORS / (name + layout)).read_bytes())
    assert cell.indices.tolist() == expected["decoded"]["indices"]
    assert cell.planes.tobytes() == planes_of(expected["decoded"]["planes"]).tobytes()
    assert cell.bound_m == pytest.approx(expected["bound_um"] * 1e-6, abs=0)


@pytest.mark.parametrize("name", CODED)
def test_the_beginning_of_a_coded_cell_is_a_coarse_cell(name: str) -> None:
    data, expected = (VECTORS / f"{name}.canonical.ccod").read_bytes(), twin(name)
    fine_bytes = len(expected["data"]) - expected["coarse_bytes"]
    end = data.rindex(bytes(expected["data"])) + expected["coarse_bytes"] if expected["data"] else len(data)
    if expected["data"] == []:
        fine_bytes = 0
    coarse = read_coarse_cell(data[:end], len(data))
    rows = np.isin(expected["decoded"]["indices"], expected["decoded"]["coarse_indices"])
    assert coarse.indices.tolist() == expected["decoded"]["coarse_indices"]
    assert coarse.planes.tobytes() == planes_of(expected["decoded"]["planes"])[rows].tobytes()
    if fine_bytes > 0:
        with pytest.raises(Error, match="coarse"):
            read_coarse_cell(data[:end - 1], len(data))


@pytest.mark.parametrize("layout", [".cpgr", ".canonical.cpgr"])
@pytest.mark.parametrize("name", GRAPHS)
def test_pose_graphs_are_what_their_twins_say(name: str, layout: str) -> None:
    graph, expected = read_pose_graph((VECTORS / (name + layout)).read_bytes()), twin(name)
    assert graph.revision == expected["revision"]
    assert graph.cells.tolist() == [node["cell"] for node in expected["nodes"]]
    for node in expected["nodes"]:
        assert np.array_equal(graph.pose(node["cell"]), pose_of(node["t_map_cell"]))
    for constraint, row in zip(graph.constraints, expected["constraints"], strict=True):
        assert (constraint.id, constraint.from_cell, constraint.to_cell) == (row["id"], row["from"], row["to"])
        assert (constraint.kind, constraint.origin) == (row["kind"].lower(), row["origin"].lower())
        assert (constraint.weight, constraint.pinned) == (row.get("weight", 1), row.get("pinned", False))
        assert np.array_equal(constraint.T_from_to, pose_of(row["t_from_to"]))
        assert all(constraint.information[i, j] == constraint.information[j, i] == row["information"][f"m{i}{j}"]
                   for i in range(6) for j in range(i, 6))
        assert vars(constraint.scores) == (row.get("scores") or dict.fromkeys(vars(constraint.scores), 0))


@pytest.mark.parametrize("layout", [".cchg", ".canonical.cchg"])
@pytest.mark.parametrize("name", CHANGES)
def test_changes_are_what_their_twins_say(name: str, layout: str) -> None:
    changes, expected = read_changes((VECTORS / (name + layout)).read_bytes()), twin(name)
    decoded = expected["decoded"]
    assert (changes.since, changes.revision) == (expected["since"], expected["revision"])
    assert changes.moved.tolist() == [row["cell"] for row in decoded["moved"]]
    for pose, row in zip(changes.T_map_moved, decoded["moved"]):
        assert np.array_equal(pose, pose_of(row["t_map_cell"]))
    for field in ("removed", "removed_constraints", "unaligned"):
        assert getattr(changes, field).tolist() == decoded.get(field, [])
    assert [a.id for a in changes.added] == [row["cell"] for row in expected["added"]]
    assert [{"id": i, "weight": w, "pinned": p} for i, w, p in changes.judged] == decoded.get("judged", [])


@pytest.mark.parametrize("name", ["with-nan", "no-points"])
def test_scans_come_back_as_they_were_and_are_written_alike(name: str) -> None:
    data = (VECTORS / f"{name}.canonical.cscn").read_bytes()
    scan, expected = read_scan(data), twin(name)
    columns = np.array([[float(v) for v in expected[axis]] for axis in "xyz"], dtype=np.float32)
    assert np.array_equal(scan.points.T, columns, equal_nan=True)
    assert (scan.index, scan.stamp_ns) == (expected["index"], expected["stamp_ns"])
    assert scan.to_bytes() == data


def test_first_probabilities_are_those_of_the_format() -> None:
    section = (ROOT / "schema" / "FORMAT.md").read_text().split("### First probabilities")[1].split("###")[0]
    lines = [line.strip() for line in section.splitlines() if line.startswith("    ")]
    assert bytes.fromhex("".join(lines)) == FIRST_PROBABILITIES[1] + FIRST_PROBABILITIES[2]


def test_every_point_has_eight_neighbours_that_are_decoded_before_it() -> None:
    for kind, size in ((1, 1000), (1, 50_000), (2, 1000)):
        for sphere in lattice_of(kind, 1, size).spheres:
            for belt in neighbour_offsets(sphere):
                for rest, offsets in enumerate(belt):
                    assert len(offsets) == 8
                    assert all(e % 4 == 0 if rest == 0 else e < 0 or (rest + e) % 4 == 0 for e in offsets)
                    assert rest != 0 or max(offsets) < 0
