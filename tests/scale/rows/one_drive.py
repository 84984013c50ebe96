"""One drive by one worker and by two, each with one processor, the database on the same machine: the second one makes parts of the
drive for the first. The same bytes and counts, and the busier of the two works less than one alone: that is what time comes to where
each has its processor to itself. Time itself is told and not judged, since anything else that runs here makes it longer."""
import re
import subprocess

from database import Cluster
from rows.two_workers import ingest
from support import Server, note, processor_s
from writers import content, require, require_same

COUNTS = ("cells", "revision", "scans", "raw_points", "voxel_points", "planes", "constraints")


def parts_made(workers):
    """How many parts each has made for another, of those that still run."""
    return [int(re.search(r"^cellmap_parts_made_total (\d+)", worker.api.call("GET", "/metrics").decode(), re.M)[1]) for worker in workers]


def run(options, folder):
    database, servers = Cluster().create(), []
    scans = 240 if options.short else 400
    try:
        subprocess.run([options.cellmap, "simulate", "--route", "town", "--scans", str(scans), "--out", str(folder / "data" / "one"),
                        "--json"], check=True, stdout=subprocess.DEVNULL)
        for name in ("api", "worker", "worker"):
            server = Server(options.cellmapd, database.address, folder / "data", "--role", name, log=folder / f"{len(servers)}.log")
            if name == "worker":
                server.command = ["taskset", "--cpu-list", str(len(servers) - 1), *server.command]
            servers.append(server)
        api, expected, ratios, relieved, work = servers[0].api, None, [], [], {}
        servers[0].start()
        for turn in range(1 if options.short else 3):
            seconds = []
            for workers in (servers[1:2], servers[1:]):
                for worker in workers:
                    worker.start()
                name = f"one-{len(workers)}-{turn}"
                seconds.append(ingest(api, [(name, "one")]))
                made = parts_made(workers)
                work[len(workers)] = [processor_s(worker.process.pid) for worker in workers]
                for worker in workers:
                    worker.stop()
                info = api.get(f"/v1/maps/{name}")
                found = content(api, name) | {"counts": [(count, info[count]) for count in COUNTS]}
                expected = expected or found
                require_same(found, expected, name)
                require((sum(made) > 0) == (len(workers) > 1), f"{name}: {made} parts were made for others")
            ratios.append(seconds[0] / seconds[1])
            relieved.append(work[1][0] / max(work[2]))
        ratio, relief = (sorted(values)[len(values) // 2] for values in (ratios, relieved))
    finally:
        for server in servers:
            server.kill()
        database.remove()
    note(f"one-drive: {scans} scans {seconds[0]:.1f} s by one worker, {seconds[1]:.1f} s by two ({ratio:.2f} times as fast), {sum(made)} parts "
         f"made for the other, the same bytes; processor {work[1][0]:.2f} s, {work[2][0]:.2f} + {work[2][1]:.2f} s: {relief:.2f} times less for the "
         f"busier one (must be above 1)")
    return {"ratios": [round(r, 2) for r in ratios], "ratio": round(ratio, 2), "relieved": [round(r, 2) for r in relieved],
            "relief": round(relief, 2), "must": 1, "last_seconds": seconds, "parts_made": made, "last_processor_s": work,
            "wrong": [] if relief > 1 else [f"two workers had no less to do than one: {relief:.2f}"]}
