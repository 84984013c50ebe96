"""What one of each costs a server and its database on a small map of simulated CELLs: processor time, bytes on the wire, bytes that
the disk is told to write. Over one connection, one after the other; processor time is that of the processes alone, so another
load of the machine changes little."""
import http.client
import json
import time
from pathlib import Path

from database import Cluster
from support import Server, World, note, processor_s
from writers import CELL


def written_bytes(pid):
    return next(int(line.split()[1]) for line in Path(f"/proc/{pid}/io").read_text().splitlines() if line.startswith("write_bytes"))


class Meter:
    """Processor time and disk writes of a server, and of its database where that is other processes."""

    def __init__(self, server, database=None):
        self.server, self.database = server, database

    def read(self):
        own = self.server.process.pid
        others = self.database.processes() if self.database else []
        return processor_s(own), sum(map(processor_s, others)), sum(map(written_bytes, [own, *others]))

    def cost(self, act, times):
        """Of one `act`, which returns how many bytes came and went."""
        before = self.read()
        wire = sum(act(i) for i in range(times)) / times
        server, others, written = (b - a for a, b in zip(before, self.read()))
        cost = {"processor_ms": round(server * 1e3 / times, 3), "wire_bytes": round(wire), "written_bytes": round(written / times)}
        return cost | ({"database_ms": round(others * 1e3 / times, 3)} if self.database else {})


class Client:
    def __init__(self, server):
        self.connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)

    def ask(self, method, path, body=None, media_type=None, accept="application/json"):
        headers = {"Accept": accept, "Accept-Encoding": "zstd"} | ({"Content-Type": media_type} if media_type else {})
        self.connection.request(method, path, body, headers)
        answer = self.connection.getresponse()
        data = answer.read()
        if answer.status >= 400:
            raise RuntimeError(f"{method} {path}: {answer.status} {data[:300]!r}")
        return len(data) + len(body or b"")


def ingest_cost(world, meter, scans):
    """Of one scan: a drive that the server reads from its disk."""
    def drive(i):
        world.ingest(f"again{i}", "drive")
        return 0
    cost = meter.cost(drive, 2)
    return {name: round(value / scans, 3) for name, value in cost.items() if name != "wire_bytes"}


def costs(world, meter, times):
    client, ids = Client(world.server), sorted(world.cells)
    scan, upload = world.scan.read_bytes(), [(digest, Path(path).read_bytes()) for digest, path in world.upload]
    batch = json.dumps({"ids": ids[:4]})
    made = []

    def put(i):
        if i % len(upload) == 0:
            made.append(f"unit{len(made)}")
            client.ask("POST", "/v1/maps", json.dumps({"name": made[-1], "lattice": world.lattice}), "application/json")
        digest, data = upload[i % len(upload)]
        return client.ask("PUT", f"/v1/maps/{made[-1]}/sessions/up/cells/{digest}", data, CELL)

    return {
        "fetch": meter.cost(lambda i: client.ask("GET", f"/v1/maps/town/cells/{ids[i % len(ids)]}", accept=CELL), times),
        "changes, none": meter.cost(lambda i: client.ask("GET", "/v1/maps/town/changes?since=" + str(world.revision),
                                                              accept="application/vnd.cellmap.changes"), times),
        "batch of 4": meter.cost(lambda i: client.ask("POST", "/v1/maps/town/cells:batch", batch, "application/json",
                                                      "application/vnd.cellmap.cells"), times // 4),
        "radius of 50 m": meter.cost(lambda i: client.ask("GET", "/v1/maps/town/cells?near=0,0,0&radius=50"), times // 4),
        "relocalisation": meter.cost(lambda i: client.ask("POST", "/v1/maps/town/relocalise", scan, "application/octet-stream"), times // 20),
        "CELL put into a map": meter.cost(put, len(upload) * max(2, times // 200)),
        "scan of an ingest": ingest_cost(world, meter, 120),
    }


def run(options, folder):
    times, row = 400 if options.short else 4000, {}
    database = Cluster(fsync="on").create()
    try:
        for engine, store, meters in (("sqlite", folder / "store.db", None), ("postgres", database.address, database)):
            of_engine = folder / engine
            of_engine.mkdir()
            server = Server(options.cellmapd, store, of_engine / "data", log=of_engine / "log")
            try:
                world = World(options, of_engine, server)
                world.revision = world.api.get("/v1/maps/town")["revision"]
                time.sleep(1)
                row[engine] = costs(world, Meter(server, meters), times)
            finally:
                server.kill()
            for what, cost in row[engine].items():
                note(f"unit-costs, {engine}: {what}: {cost}")
    finally:
        database.remove()
    return row | {"wrong": []}
