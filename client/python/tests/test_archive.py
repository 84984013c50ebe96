"""Archives from a disk."""

import os

import numpy as np
import pytest
from conftest import SCANS, VECTORS, Server, run, twin
from test_vectors import pose_of

from cellmap import Client, Error, open_archive
from cellmap.archived_scans import read_archived_scans
from cellmap.flatbuffer import Builder


@pytest.mark.parametrize("name", ["three-cells", "with-leaves", "updated", "half-updated"])
def test_archives_are_what_their_twins_say(name: str) -> None:
    expected = twin(f"{name}.cellmap")
    with open_archive(VECTORS / f"{name}.cellmap") as archive:
        assert archive.summary.map == expected["map"]
        assert archive.summary.sessions == tuple(session["name"] for session in expected["sessions"])
        graph = archive.pose_graph
        assert graph.revision == expected["revision"]
        assert len(graph.constraints) == expected["constraints"]
        for entry, row in zip(archive.cells, expected["cells"], strict=True):
            for field in ("id", "hash", "session", "sequence", "planes", "bytes"):
                assert getattr(entry, field) == row[field]
            assert np.array_equal(graph.pose(entry.id), pose_of(row["t_map_cell"]))
            cell = archive.cell(entry.id)
            assert (cell.hash, len(cell.planes), len(cell.to_bytes())) == (entry.hash, entry.planes, entry.bytes)
        for found, row in zip(archive.scans, expected["scans"], strict=True):
            assert (found.cell, found.raw_points, found.voxel_points) == (row["id"], row["raw_points"], row["voxel_points"])
            assert np.array_equal(found.T_odom_cell, pose_of(row["t_odom_cell"]))
            assert found.stamps_ns.tolist() == [scan["stamp_ns"] for scan in row["scans"]]
            for pose, scan in zip(found.T_cell_scan, row["scans"], strict=True):
                assert np.array_equal(pose, pose_of(scan["t_cell_scan"]))
        where, there = archive.summary.georeference, expected["georeference"]
        assert where is not None
        assert (where.latitude_deg, where.longitude_deg, where.height_m) == (
            there["latitude_deg"], there["longitude_deg"], there["height_m"])
        assert np.array_equal(where.R_enu_map, pose_of(there["t_enu_map"])[:3, :3])


def test_what_is_not_there_is_not_found() -> None:
    with pytest.raises(Error) as caught:
        open_archive("/nowhere/town.cellmap")
    assert caught.value.code == "not-found"
    for name in ("three-cells", "with-leaves"):
        with open_archive(VECTORS / f"{name}.cellmap") as archive:
            for cell in (0, 5, 4000):
                with pytest.raises(Error) as caught:
                    archive.cell(cell)
                assert caught.value.code == "not-found"


def test_a_file_that_is_no_archive_is_refused(tmp_path) -> None:
    path = tmp_path / "odd.cellmap"
    for content in (b"", b"PK", bytes(20_000)):
        path.write_bytes(content)
        with pytest.raises(Error, match="no CELLmap archive"):
            open_archive(path)


@pytest.mark.parametrize("encoding", ["packed", "compact"])
def test_scans_of_an_archive_are_those_of_the_drive(server: Server, tmp_path, encoding: str) -> None:
    path = tmp_path / "town.cellmap"
    run(os.environ["CELLMAP_PROGRAM"], "archive", "town", "--server", server.url, "--encoding", encoding, "--out", path)
    with open_archive(path) as archive:
        assert archive.summary.georeference is None
        assert archive.summary.scans == SCANS == sum(len(scans.stamps_ns) for scans in archive.scans)
        assert [scans.cell for scans in archive.scans] == [cell.id for cell in archive.cells]
        stamps = np.concatenate([scans.stamps_ns for scans in archive.scans])
        assert (np.diff(stamps) > 0).all()
        for scans in archive.scans:
            cell = Client(server.url).cell("town", scans.cell)
            assert np.allclose(scans.T_odom_cell, cell.T_odom_cell, atol=1e-3)
            assert len(scans.stamps_ns) == cell.scan_count
            # The CELL's frame is that of its base scan, the first.
            assert np.allclose(scans.T_cell_scan[0], np.eye(4), atol=1e-4)


def scans_of(count: int, columns: dict[int, bytes]) -> bytes:
    builder = Builder()
    fields = {i: ("ref", builder.vector(column, len(column), 1)) for i, column in columns.items()}
    return builder.finish(builder.table({0: ("H", 1), 1: ("I", count), **fields}), b"CASC")


@pytest.mark.parametrize("count, columns", [
    ((1 << 32) - 1, {}),  # as many CELLs as the number holds
    (1, {3: (2 * 100_001).to_bytes(4, "little")}),  # too many scans of one CELL
    (1, {3: (2 * 90_000).to_bytes(4, "little")}),  # scans without bytes
    (1, {3: b"\x01"}),  # minus one scan
    (2, {2: b"\x02\x03"}),  # CELLs not in order: 1, 0
    (1, {8: b"\xff" * 8}),  # a pose beyond the grid
])
def test_a_list_of_scans_that_lies_is_refused_before_memory_is_taken(count: int, columns: dict[int, bytes]) -> None:
    whole = {i: b"" for i in (2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13)}
    assert read_archived_scans(scans_of(1, whole), 1 << 20)[0].cell == 0
    with pytest.raises(Error) as caught:
        read_archived_scans(scans_of(count, {**whole, **columns}), 1 << 20)
    assert caught.value.code == "corrupt-data"
