#!/usr/bin/env python3
"""Three cellmapd over one PostgreSQL that search for places together (--place-servers), with tokens: each gives the answer of a server
alone, also when one of them hangs and when one is killed.

Usage: place_servers.py CELLMAP CELLMAPD      exit code 77: PostgreSQL is not installed
"""
import http.client
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parent.parent
sys.dont_write_bytecode = True
sys.path += [str(TESTS / "scale"), str(TESTS / "crash")]
from database import Cluster, programs  # noqa: E402
from rules import check, failures  # noqa: E402
from server import Server  # noqa: E402


class Fleet:
    def __init__(self, cellmap, cellmapd, folder):
        self.cellmap, self.cellmapd, self.folder = cellmap, cellmapd, folder
        (folder / "data").mkdir()
        self.database = Cluster().create()
        self.tokens = folder / "tokens"
        self.admin, self.robot = self.token("root", "admin"), self.token("robot", "relocalise")

    def run(self, *arguments):
        return subprocess.run([self.cellmap, *map(str, arguments)], check=True, capture_output=True, text=True).stdout

    def token(self, name, scope):
        return self.run("token", "create", name, "--tokens", self.tokens, "--scope", scope).strip()

    def server(self, name):
        return Server(self.cellmapd, self.database.address, self.folder / "data", "--tokens", self.tokens, log=self.folder / f"{name}.log")

    def start(self, server):
        server.spawn()
        for _ in range(600):
            try:
                if self.ask(server, "GET", "/readyz")[0] == 200:
                    return
            except OSError:
                pass
            time.sleep(0.05)
        sys.exit(f"cellmapd does not answer: {Path(server.log.name).read_text()}")

    def ask(self, server, method, path, body=None, token=None):
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        headers = {"Authorization": f"Bearer {token or self.admin}", "Content-Type": "application/octet-stream"}
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read()

    def place_of(self, server, scan, token=None):
        """A relocalisation without what differs from one to the next."""
        status, body = self.ask(server, "POST", "/v1/maps/town/relocalise", scan, token or self.robot)
        answer = json.loads(body)
        answer.pop("time_ms", None)
        return status, answer

    def searches(self, server):
        """How often it asked which server with what outcome."""
        text = self.ask(server, "GET", "/metrics")[1].decode()
        pattern = r'cellmap_place_searches_total\{(?=.*outcome="(\w+)")(?=.*server="([^"]+)").*\} (\S+)'
        return {(url, outcome): float(count) for outcome, url, count in re.findall(pattern, text)}


def asked_by(fleet, servers, urls):
    """A server and another one that it asks: not every one has a region of so small a map."""
    for server in servers:
        for (url, outcome), count in fleet.searches(server).items():
            if outcome == "answered" and count:
                return server, servers[urls.index(url)]
    raise RuntimeError("no server asks another")


def run(fleet):
    fleet.run("simulate", "--route", "town", "--scans", "100", "--columns", "500", "--out", fleet.folder / "data" / "drive")
    alone = fleet.server("alone")
    fleet.start(alone)
    subprocess.run([fleet.cellmap, "ingest", fleet.folder / "data" / "drive", "--map", "town", "--cell-distance", "4", "--server",
                    f"http://127.0.0.1:{alone.port}"], check=True, capture_output=True, env={"CELLMAP_TOKEN": fleet.admin})
    scans = [file.read_bytes() for file in sorted((fleet.folder / "data" / "drive").rglob("*.bin"))[7::40]]
    expected = [fleet.place_of(alone, scan) for scan in scans]
    alone.stop()
    check(all(status == 200 and answer["found"] for status, answer in expected), "a server alone finds the places", expected)

    servers = [fleet.server(f"server-{i}") for i in range(3)]
    urls = [f"http://127.0.0.1:{server.port}" for server in servers]
    try:
        for server, url in zip(servers, urls):
            server.command += ["--place-servers", ",".join(urls), "--place-self", url, "--place-alone", "0", "--place-timeout", "3"]
            fleet.start(server)
        for i, server in enumerate(servers):
            answers = [fleet.place_of(server, scan) for scan in scans]
            check(answers == expected, f"server {i} of three gives the answers of one alone", answers)
        outcomes = {outcome for server in servers for _, outcome in fleet.searches(server)}
        check(outcomes == {"answered"}, "they asked each other, and all answered", outcomes)

        asker, other = asked_by(fleet, servers, urls)
        other.process.send_signal(signal.SIGSTOP)
        begun = time.monotonic()
        check(fleet.place_of(asker, scans[0]) == expected[0], "the same answer while another one hangs")
        took = time.monotonic() - begun
        check(3 <= took < 30, "which is waited for until the deadline", took)
        begun = time.monotonic()
        check(fleet.place_of(asker, scans[1]) == expected[1] and time.monotonic() - begun < 3, "and then left alone")
        other.process.send_signal(signal.SIGCONT)
        url = urls[servers.index(other)]
        before = fleet.searches(asker)[url, "answered"]
        time.sleep(5.5)
        check(fleet.place_of(asker, scans[0]) == expected[0] and fleet.searches(asker)[url, "answered"] > before, "until it is back")

        other.kill()
        answers = [fleet.place_of(asker, scan) for scan in scans]
        check(answers == expected, "the same answers without a server that was killed", answers)
        check(fleet.searches(asker)[url, "failed"] == 2, "which was asked once more", fleet.searches(asker))
        log = Path(asker.log.name).read_text()
        check(log.count("searches the regions of") == 1, "the log says so, once a minute at most", log)
    finally:
        for server in servers:
            if server.process and server.process.poll() is None:
                server.kill()
    return 1 if failures else 0


def main():
    if not programs():
        print("no PostgreSQL server is installed (./install-dependencies.sh --with-postgresql)")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(*sys.argv[1:], Path(folder))
        try:
            return run(fleet)
        finally:
            fleet.database.remove()


if __name__ == "__main__":
    sys.exit(main())
