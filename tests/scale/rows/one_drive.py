"""One drive by one worker and by two, each with one processor, the database on the same machine: the second one makes parts of the
drive for the first. Faster by two, and the same bytes and counts."""
import re
import subprocess

from database import Cluster
from rows.two_workers import ingest
from support import Server, note
from writers import content, require, require_same

COUNTS = ("cells", "revision", "scans", "raw_points", "voxel_points", "planes", "constraints")


def parts_made(workers):
    """How many parts each has made for another, of those that still run."""
    return [int(re.search(r"^cellmap_parts_made_total (\d+)", worker.api.call("GET", "/metrics").decode(), re.M)[1]) for worker in workers]


def run(options, folder):
    database, servers = Cluster().create(), []
    scans = 120 if options.short else 600
    try:
        subprocess.run([options.cellmap, "simulate", "--route", "town", "--scans", str(scans), "--columns", "1000", "--out",
                        str(folder / "data" / "one"), "--json"], check=True, stdout=subprocess.DEVNULL)
        for name in ("api", "worker", "worker"):
            server = Server(options.cellmapd, database.address, folder / "data", "--role", name, log=folder / f"{len(servers)}.log")
            if name == "worker":
                server.command = ["taskset", "--cpu-list", str(len(servers) - 1), *server.command]
            servers.append(server)
        api, expected, ratios = servers[0].api, None, []
        servers[0].start()
        for turn in range(1 if options.short else 3):
            seconds = []
            for workers in (servers[1:2], servers[1:]):
                for worker in workers:
                    worker.start()
                name = f"one-{len(workers)}-{turn}"
                seconds.append(ingest(api, [(name, "one")]))
                made = parts_made(workers)
                for worker in workers:
                    worker.stop()
                info = api.get(f"/v1/maps/{name}")
                found = content(api, name) | {"counts": [(count, info[count]) for count in COUNTS]}
                expected = expected or found
                require_same(found, expected, name)
                require((sum(made) > 0) == (len(workers) > 1), f"{name}: {made} parts were made for others")
            ratios.append(seconds[0] / seconds[1])
        ratio = sorted(ratios)[len(ratios) // 2]
    finally:
        for server in servers:
            server.kill()
        database.remove()
    note(f"one-drive: {scans} scans {seconds[0]:.1f} s by one worker, {seconds[1]:.1f} s by two, {sum(made)} parts made for the other: "
         f"{ratio:.2f} times as fast (must be above 1), the same bytes")
    return {"ratios": [round(r, 2) for r in ratios], "ratio": round(ratio, 2), "must": 1, "last_seconds": seconds, "parts_made": made,
            "wrong": [] if ratio > 1 else [f"two workers were not faster than one: {ratio:.2f}"]}
