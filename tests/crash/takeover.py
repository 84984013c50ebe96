#!/usr/bin/env python3
"""Several cellmapd over one PostgreSQL database: one that takes jobs (--role api) and two that carry them out (--role worker).
The worker that carries out an ingest is killed, stopped for longer than its lease, and asked to end, each in the middle of the
drive; the other one must end the job, and CELLs, poses and constraints must be those of an undisturbed run, bit by bit.

A database is made in the cluster of tests/support/postgres.sh whose folder CELLMAP_TEST_POSTGRES names, and goes with the test.
Exit code 77: none runs.
"""
import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from crash import LATTICE, simulate, wait_for
from server import Refused, Server
from writers import content, require_same

LEASE_S = 1.5
SCANS = 120
ATTEMPTS = 10  # a quick worker may end a job before anybody disturbs it


class Database:
    """One of its own, in a cluster that others use too."""

    def __init__(self, socket_folder):
        self.folder, self.name = socket_folder, f"takeover_{os.getpid()}"
        programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/psql"))
        self.psql = str(programs[-1]) if programs else "psql"
        self.run(f"CREATE DATABASE {self.name}")
        self.url = f"postgresql:///{self.name}?user=postgres&host={socket_folder}"

    def run(self, sql):
        subprocess.run([self.psql, "--no-psqlrc", "--quiet", "-h", self.folder, "-U", "postgres", "-d", "postgres", "-c", sql],
                       check=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.run(f"DROP DATABASE {self.name} WITH (FORCE)")


class Fleet:
    """An api server and two workers, made anew where they were killed."""

    def __init__(self, options, database, folder, stack):
        def server(name, role, lease):
            made = Server(options.cellmapd, database.url, folder / "data", "--role", role, "--job-lease", str(lease),
                          log=folder / f"{name}.log")
            stack.callback(made.kill)
            made.start()
            return made
        self.new_worker = lambda name, lease: server(name, "worker", lease)
        self.api = server("api", "api", LEASE_S).api

    def ingest(self, name):
        return self.api.send("POST", f"/v1/maps/{name}/jobs",
                             {"kind": "ingest", "create_map": True, "lattice": LATTICE, "path": "drive", "session": "drive"})

    def job_at_work(self, job, cells):
        """The job as it is when it has committed this many CELLs; None where it ended before anybody looked."""
        while True:
            state = self.api.get(f"/v1/jobs/{job['id']}")
            if state["state"] not in ("queued", "running"):
                return None
            if state["worker"] and state["cells_done"] >= cells:
                return state
            time.sleep(0.001)


def process_of(state):
    """A worker is named by machine, process and chance."""
    return int(state["worker"].split(":")[-2])


def disturbed(fleet, name, cells, disturb, restore, expected):
    """Ingests into a map while the worker that begins is disturbed, so that another one has to end it. Returns the map's name."""
    for attempt in range(ATTEMPTS):
        place = f"{name}-{attempt}"
        job = fleet.ingest(place)
        begun = fleet.job_at_work(job, cells)
        if not begun:
            continue
        disturb(process_of(begun))
        while True:
            now = fleet.api.get(f"/v1/jobs/{job['id']}")
            if now["worker"] not in (None, begun["worker"]) or now["state"] not in ("queued", "running"):
                break
            time.sleep(0.001)
        wait_for(fleet.api, job)
        require_same(content(fleet.api, place), expected, place)
        info = fleet.api.get(f"/v1/maps/{place}")
        revisions = info["revision"]
        assert revisions == info["cells"], f"{place}: {revisions} revisions of {info['cells']} CELLs: something was written twice"
        if now["worker"] != begun["worker"]:
            print(f"{place}: {begun['worker']} at {begun['cells_done']} CELLs of {info['cells']}, then {now['worker']}", flush=True)
            return place
        restore(process_of(begun))
    raise AssertionError(f"{name}: nobody took a job over, or each had ended before it was disturbed")


def check_roles(fleet, worker):
    """A worker says how it is, and what to do, and nothing else."""
    for path in ("/healthz", "/readyz", "/metrics"):
        worker.api.call("GET", path)
    for path in ("/v1/maps", "/", "/nothing"):
        try:
            worker.api.call("GET", path)
            raise AssertionError(f"a worker answered {path}")
        except Refused as refused:
            assert refused.status == 503 and b"--role" in refused.args[0].encode(), refused
    try:
        fleet.api.send("POST", "/v1/maps/first/jobs", {"kind": "ingest", "session": "up", "upload": True})
        raise AssertionError("a server that carries out no jobs took an upload")
    except Refused as refused:
        assert refused.status == 503, refused


def run(options, folder, database):
    simulate(options.cellmap, folder, "drive", SCANS, 5)
    with ExitStack() as stack:
        fleet = Fleet(options, database, folder, stack)
        first = fleet.new_worker("first", LEASE_S)
        wait_for(fleet.api, fleet.ingest("first"))
        expected = content(fleet.api, "first")
        assert len(expected["cells"]) >= 8, "the drive is too short to be disturbed"
        check_roles(fleet, first)

        second = fleet.new_worker("second", LEASE_S)
        workers = {worker.process.pid: worker for worker in (first, second)}

        def start_again(pid):
            worker = workers.pop(pid)
            worker.start()
            workers[worker.process.pid] = worker

        for cells in (1, 4):
            killed = []

            def kill(pid):
                workers[pid].kill()
                killed[:] = [pid]

            disturbed(fleet, f"killed-at-{cells}", cells, kill, start_again, expected)
            start_again(killed[0])

        suspended = []

        def suspend(pid):
            os.kill(pid, signal.SIGSTOP)
            suspended[:] = [pid]

        def wake(pid):
            os.kill(pid, signal.SIGCONT)
            workers[pid].start()  # returns when it answers

        place = disturbed(fleet, "suspended", 3, suspend, wake, expected)
        wake(suspended[0])  # it thinks that the job is still its own
        time.sleep(2 * LEASE_S)
        require_same(content(fleet.api, place), expected, "suspended, after its first worker woke up")
        assert workers[suspended[0]].process.poll() is None, "a worker that lost its job ended"

        for worker in workers.values():
            worker.stop()
        patient = [fleet.new_worker(name, 3600) for name in ("third", "fourth")]
        workers = {worker.process.pid: worker for worker in patient}
        disturbed(fleet, "handed-back", 2, lambda pid: workers[pid].stop(), start_again, expected)  # nobody waits for an hour
        next(worker for worker in patient if worker.process.poll() is not None).start()

        job = fleet.ingest("cancelled")
        assert fleet.job_at_work(job, 1), "the job had ended before it was cancelled"
        fleet.api.send("DELETE", f"/v1/jobs/{job['id']}")  # not sent to whoever carries it out
        while (state := fleet.api.get(f"/v1/jobs/{job['id']}")["state"]) == "running":
            time.sleep(0.01)
        assert state == "cancelled", state


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    parser.add_argument("--folder", type=Path, help="where drive and logs go, and stay (default: a temporary one)")
    options = parser.parse_args()
    cluster = os.environ.get("CELLMAP_TEST_POSTGRES", "")
    if not cluster or not os.path.exists(cluster):
        print("SKIPPED: no PostgreSQL runs for this test (CELLMAP_TEST_POSTGRES; tests/support/postgres.sh start FOLDER)")
        return 77
    with tempfile.TemporaryDirectory() as temporary, Database(os.path.realpath(cluster)) as database:
        folder = (options.folder or Path(temporary)).resolve()
        (folder / "data").mkdir(parents=True, exist_ok=True)
        run(options, folder, database)
    print("every job was ended by another worker, with the same bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
