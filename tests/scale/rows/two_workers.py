"""Two drives into two maps, by one worker and by two, the database on the same machine. A worker carries out jobs of several maps at
a time, so each is given one processor, as a machine of its own would have; faster by two, and the same bytes."""
import subprocess
import time

from crash import wait_for
from database import Cluster
from support import Server, note
from writers import content, require_same


def ingest(api, names):
    """Seconds until both jobs have ended."""
    begun = time.monotonic()
    jobs = [api.send("POST", f"/v1/maps/{name}/jobs", {"kind": "ingest", "path": drive, "session": "drive", "create_map": True})
            for name, drive in names]
    for job in jobs:
        wait_for(api, job)
    return time.monotonic() - begun


def run(options, folder):
    database, servers = Cluster().create(), []
    scans = 60 if options.short else 240
    try:
        for drive, seed in (("one", 1), ("two", 2)):
            subprocess.run([options.cellmap, "simulate", "--route", "town", "--scans", str(scans), "--columns", "1000", "--traffic-seed",
                            str(seed), "--out", str(folder / "data" / drive), "--json"], check=True, stdout=subprocess.DEVNULL)
        for name in ("api", "worker", "worker"):
            server = Server(options.cellmapd, database.address, folder / "data", "--role", name, log=folder / f"{len(servers)}.log")
            if name == "worker":
                server.command = ["taskset", "--cpu-list", str(len(servers) - 1), *server.command]
            servers.append(server)
        api, maps, ratios = servers[0].api, {}, []
        servers[0].start()
        for turn in range(1 if options.short else 3):
            seconds = []
            for workers in (servers[1:2], servers[1:]):
                for worker in workers:
                    worker.start()
                names = [(f"{drive}-{len(workers)}-{turn}", drive) for drive in ("one", "two")]
                seconds.append(ingest(api, names))
                for name, drive in names:
                    found = content(api, name)
                    require_same(found, maps.setdefault(drive, found), name)
                for worker in workers:
                    worker.stop()
            ratios.append(seconds[0] / seconds[1])
        ratio = sorted(ratios)[len(ratios) // 2]
    finally:
        for server in servers:
            server.kill()
        database.remove()
    note(f"two-workers: two drives of {scans} scans {seconds[0]:.1f} s by one worker, {seconds[1]:.1f} s by two: {ratio:.2f} times as fast (must be "
         f"above 1), the same bytes")
    return {"ratios": [round(r, 2) for r in ratios], "ratio": round(ratio, 2), "must": 1, "last_seconds": seconds,
            "wrong": [] if ratio > 1 else [f"two workers were not faster than one: {ratio:.2f}"]}
