"""Archives from a disk."""

import numpy as np
import pytest
from conftest import VECTORS, twin
from test_vectors import pose_of

from cellmap import Error, open_archive


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
