"""The whole client against a real cellmapd."""

import http.server
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import SCANS, Server

from cellmap import Client, Error, Scan, moved, open_archive, pose_of_vector, read_kitti


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    with Client(server.url) as client:
        yield client


def points_of(server: Server, scan: int) -> np.ndarray:
    return read_kitti(str(server.folder / "drive" / "velodyne" / f"{scan:06d}.bin"))


def drive(client: Client, server: Server, scans: int) -> Iterator[Scan]:
    stamps, poses = client.trajectory("town", "monday", odometry=True)
    for i in range(scans):
        yield Scan(i, int(stamps[i] * 1e9), poses[i], points_of(server, i)[:, :3])


def test_maps_and_sessions_are_listed(client: Client) -> None:
    summary = client.map("town")
    assert summary.name in [m.name for m in client.maps()]
    assert summary.scans == SCANS and summary.cells > 3 and summary.lattice["size"] == 20_000
    (session,) = client.sessions("town")
    assert (session.name, session.cells, session.aligned) == ("monday", summary.cells, True)
    assert session.T_map_odom is not None and session.T_map_odom.shape == (4, 4)


def test_cells_come_as_arrays_one_by_one_and_together(client: Client) -> None:
    summaries = client.cells("town")
    assert sum(s.planes for s in summaries) == client.map("town").planes
    together = dict(client.load_cells("town"))
    assert sorted(together) == [s.id for s in summaries]
    for summary in summaries:
        cell = together[summary.id]
        assert (cell.hash, len(cell.planes), cell.session) == (summary.hash, summary.planes, "monday")
        assert client.cell("town", summary.id).planes.tobytes() == cell.planes.tobytes()


def test_a_coded_cell_is_the_cell_within_its_bound(client: Client) -> None:
    whole, coded = client.cell("town", 2), client.cell("town", 2, bound_m=0.02)
    assert coded.hash == whole.hash and coded.bound_m == 0.02
    assert np.array_equal(coded.indices, whole.indices)
    along_normal = np.einsum("ij,ij->i", coded.points - whole.points, whole.normals.astype(float))
    assert np.abs(along_normal).max() <= 0.02 + 1e-4


def test_near_finds_what_is_near(client: Client) -> None:
    every = client.cells("town")
    centre = every[2].T_map_cell[:3, 3]
    near = client.cells("town", near=centre.tolist(), radius_m=10)
    distances = [np.linalg.norm(s.T_map_cell[:3, 3] - centre) for s in near]
    assert distances == sorted(distances) and distances[0] == 0
    assert {s.id for s in near} == {s.id for s in every if np.linalg.norm(s.T_map_cell[:3, 3] - centre) <= 10}


def test_surfaces_of_neighbours_lie_together_in_the_map(client: Client) -> None:
    """Frames are right only if CELLs that see the same walls put them at the same place."""
    graph, cells = client.pose_graph("town"), dict(client.load_cells("town"))
    a, b = (moved(cells[i].points[np.linalg.norm(cells[i].points, axis=1) < 15], graph.pose(i)) for i in (2, 3))
    nearest = np.array([np.linalg.norm(b - p, axis=1).min() for p in a])
    assert np.median(nearest) < 0.3


def test_the_pose_graph_agrees_with_the_list_of_cells(client: Client) -> None:
    graph = client.pose_graph("town")
    for summary in client.cells("town"):
        assert np.allclose(graph.pose(summary.id), summary.T_map_cell, atol=1e-9)
    assert graph.revision == client.map("town").revision
    assert len(graph.constraints) == client.map("town").constraints
    with pytest.raises(KeyError):
        graph.pose(4000)


def test_all_changes_from_the_beginning_make_the_map(client: Client) -> None:
    changes = client.changes("town", 0)
    assert {a.id: a.hash for a in changes.added} == {s.id: s.hash for s in client.cells("town")}
    empty = client.changes("town", changes.revision)
    assert empty.since == empty.revision and len(empty.moved) == 0


def test_a_scan_is_found_where_it_was_taken(client: Client, server: Server) -> None:
    _, truth = client.trajectory("town", "monday")
    answer = client.relocalise("town", points_of(server, 33))
    assert answer.found and answer.T_map_scan is not None and answer.covariance is not None
    assert np.linalg.norm(answer.T_map_scan[:3, 3] - truth[33][:3, 3]) < 0.1
    assert answer.covariance.shape == (6, 6) and answer.confidence > 0.5
    with_prior = client.relocalise("town", points_of(server, 33)[:, :3], prior=truth[33], radius_m=5)
    assert with_prior.found and with_prior.cells_considered <= answer.cells_considered


def test_noise_is_found_nowhere(client: Client) -> None:
    noise = np.random.default_rng(1).normal(scale=20, size=(20_000, 3))
    answer = client.relocalise("town", noise)
    assert not answer.found and answer.T_map_scan is None and answer.cell is None


def test_a_cell_is_found_at_its_pose(client: Client) -> None:
    answer = client.relocalise("town", client.cell("town", 3))
    assert answer.found and answer.T_map_scan is not None
    assert np.linalg.norm(answer.T_map_scan[:3, 3] - client.pose_graph("town").pose(3)[:3, 3]) < 0.1


def test_a_map_is_copied_cell_by_cell(client: Client) -> None:
    client.create_map("copy", 20_000)
    cell, pose = client.cell("town", 1), pose_of_vector([5, 6, 7, 0, 0, 0, 1])
    summary = client.put_cell("copy", 9, cell, pose)
    assert summary.hash == cell.hash and np.allclose(summary.T_map_cell, pose)
    with pytest.raises(Error) as caught:
        client.put_cell("copy", 9, client.cell("town", 2))
    assert caught.value.code in ("conflict", "already-exists") and caught.value.status == 409
    client.delete_map("copy")
    assert "copy" not in [m.name for m in client.maps()]


def test_an_uploaded_drive_becomes_a_map_and_says_how_far_it_is(client: Client, server: Server) -> None:
    seen = []
    client.create_map("sent", 20_000)
    job = client.upload("sent", "tuesday", drive(client, server, 40), on_progress=seen.append)
    assert (job.state, job.scans_done) == ("succeeded", 40)
    assert client.map("sent").scans == 40 and client.map("sent").cells == job.cells_done > 1
    again = client.upload("sent", "tuesday", drive(client, server, 40))
    assert again.state == "succeeded" and client.map("sent").cells == job.cells_done


def test_a_drive_on_the_server_is_ingested_with_progress(client: Client) -> None:
    job = client.ingest("ingested", "drive", session="wednesday", options={"cell_distance_m": 10})
    last = None
    for last in client.follow(job.id):
        assert last.id == job.id and (last.progress is None or 0 <= last.progress <= 1)
    assert last is not None and last.ended and last.state == "succeeded" and last.scans_done == SCANS
    assert client.wait(job.id).state == "succeeded"
    assert [j.id for j in client.jobs("ingested")] == [job.id]
    assert next(client.revisions("ingested")) == client.map("ingested").revision


def test_a_job_that_fails_says_why(client: Client, server: Server) -> None:
    broken = server.folder / "broken" / "velodyne"
    broken.mkdir(parents=True)
    (broken / "000000.bin").write_bytes(b"odd")
    with pytest.raises(Error) as caught:
        client.wait(client.ingest("broken-map", "broken", session="x").id)
    assert caught.value.code != "internal" and caught.value.message


def test_loops_are_added_explained_pinned_and_deleted(client: Client) -> None:
    name = "town"
    graph = client.pose_graph(name)
    a, b = int(graph.cells[0]), int(graph.cells[-1])
    measured = np.linalg.inv(graph.pose(a)) @ graph.pose(b)
    loop = client.add_loop(name, a, b, measured)["loops"][0]["id"]
    assert client.explain_loop(name, loop)["gap_m"] < 0.05
    assert client.pin_loop(name, loop)["pinned"] is True
    before = client.pose_graph(name)
    (mine,) = [c for c in before.loops if c.id == loop]
    assert np.allclose(mine.T_from_to, measured, atol=1e-9) and mine.origin == "user"
    revision = client.delete_loop(name, loop)
    after = client.pose_graph(name)
    assert after.revision == revision and loop not in [c.id for c in after.loops]
    updated = client.changes(name, before.revision).applied_to(before)
    assert updated.revision == revision and [c.id for c in updated.constraints] == [c.id for c in after.constraints]
    assert np.allclose(updated.T_map_cell, after.T_map_cell, atol=2e-4)
    assert client.pose_graph(name, before.revision).revision == before.revision


def test_a_map_goes_through_an_archive_and_is_read_from_it(client: Client, server: Server, tmp_path: Path) -> None:
    path = tmp_path / "town.cellmap"
    client.save_archive("town", path)
    with open_archive(path) as archive:
        assert archive.summary.encoding == "packed"
        assert {e.id: e.hash for e in archive.cells} == {s.id: s.hash for s in client.cells("town")}
        assert archive.cell(2).to_bytes() == client.cell("town", 2).to_bytes()
        assert np.array_equal(archive.pose_graph.T_map_cell, client.pose_graph("town").T_map_cell)
    assert client.restore_archive("restored", path).cells == client.map("town").cells
    with open_archive(f"{server.url}/v1/maps/town/archive?encoding=compact&bound=0.01") as remote:
        assert remote.summary.bound_m == 0.01
        assert remote.cell(2).hash == client.cell("town", 2).hash
    client.delete_map("restored")


def test_errors_carry_the_servers_code(client: Client) -> None:
    for call, code, status in [
        (lambda: client.map("atlantis"), "not-found", 404),
        (lambda: client.cell("town", 4000), "not-found", 404),
        (lambda: client.create_map("town"), "already-exists", 409),
        (lambda: client.create_map("Not A Name"), "invalid-argument", 400),
        (lambda: client.ingest("town", "/etc", session="x"), "invalid-argument", 400),
        (lambda: list(client.load_cells("town", [4000])), "not-found", None),
    ]:
        with pytest.raises(Error) as caught:
            call()
        assert (caught.value.code, caught.value.status if status else None) == (code, status)
        assert caught.value.message and str(caught.value).startswith(code)


def test_a_server_that_is_not_there_is_unavailable() -> None:
    with pytest.raises(Error) as caught:
        Client("http://127.0.0.1:1").maps()
    assert (caught.value.code, caught.value.status) == ("unavailable", None)


@pytest.mark.parametrize("arguments", [("ftp://x",), ("http://127.0.0.1", "two words"), ("http://127.0.0.1", "")])
def test_odd_addresses_and_tokens_are_refused_at_once(arguments: tuple[str, ...]) -> None:
    with pytest.raises(Error) as caught:
        Client(*arguments)
    assert caught.value.code == "invalid-argument"


class Recorder(http.server.BaseHTTPRequestHandler):
    """Says which token came; closes every connection, as a proxy may."""

    seen: list[str | None] = []

    def do_GET(self) -> None:
        Recorder.seen.append(self.headers.get("Authorization"))
        body = b'{"maps": []}' if self.headers.get("Authorization") else b"no"
        self.send_response(200 if len(body) > 2 else 401)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


def test_a_token_is_sent_with_every_request_and_its_lack_is_told() -> None:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Recorder) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{other.server_address[1]}"
        client = Client(url, "s3cret")
        assert client.maps() == client.maps() == []
        assert Recorder.seen == ["Bearer s3cret", "Bearer s3cret"]
        with pytest.raises(Error) as caught:
            Client(url).maps()
        assert (caught.value.code, caught.value.status) == ("unauthenticated", 401)
        other.shutdown()
