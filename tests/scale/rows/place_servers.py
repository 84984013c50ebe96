"""The search for places of 10^5 and 10^6 synthetic CELLs shared out among 1, 2 and 3 servers of one database (--place-servers), over loopback:
what each keeps in memory, what a query without a prior takes at first and then, and that every server gives the same answer, also while
another one hangs. Things at random around each CELL are described and kept in the store; the bytes of all CELLs are those of one simulated CELL, so
that the places found can be tried, which none of them stands. All servers and the database run on this machine: what several machines
would gain in time cannot be seen, what each has to do and to keep can."""
import http.client
import json
import signal
import subprocess
import time
from pathlib import Path

from database import Cluster
from rows.capacity import fill_postgres
from support import Server, memory_mib, note, percentile, processor_s

QUERIES = 7


def simulated(options, folder):
    """The drive of a CELL, and a scan of another town."""
    for name, seed in (("drive", 1), ("elsewhere", 77)):
        subprocess.run([options.cellmap, "simulate", "--route", "town", "--seed", str(seed), "--scans", "12", "--columns", "500",
                        "--out", str(folder / "data" / name), "--json"], check=True, stdout=subprocess.DEVNULL)
    return sorted((folder / "data" / "elsewhere").rglob("*.bin"))[-1].read_bytes()


def one_cell(options, database, folder):
    """SQL of the hash of a CELL of the drive, which a server has made of it."""
    server = Server(options.cellmapd, database.address, folder / "data", log=folder / "fill.log")
    try:
        server.start()
        job = server.api.send("POST", "/v1/maps/real/jobs", {"kind": "ingest", "path": "drive", "session": "d", "create_map": True})
        while job["state"] in ("queued", "running"):
            time.sleep(0.1)
            job = server.api.get(f"/v1/jobs/{job['id']}")
    finally:
        server.stop()
    return "(SELECT hash FROM cell WHERE map = (SELECT id FROM map WHERE name = 'real') ORDER BY id LIMIT 1)"


def fill(options, database, folder, name, cells, one):
    """A map all of whose CELLs are that one, but for what is known of their places."""
    fill_postgres(options, database, folder, {name: cells})
    database.sql(f"UPDATE cell SET hash = {one} WHERE map = (SELECT id FROM map WHERE name = '{name}')")
    database.sql("VACUUM ANALYZE cell")
    bench = Path(options.cellmap).parent.parent / "tests" / "bench" / "cellmap_bench"
    subprocess.run([bench, "--keep-places-of", database.address, name], check=True)


def metric(server, name):
    """The sum of a metric over its labels that hold all of the words after the first one."""
    name, *labels = name.split()
    lines = server.api.call("GET", "/metrics").decode().splitlines()
    return sum(float(line.split()[-1]) for line in lines if line.startswith(name) and all(label in line for label in labels))


def ask(server, name, scan):
    """Seconds of a query, which may take minutes where a million CELLs are read first, and its answer without them."""
    begun = time.perf_counter()
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=600)
    connection.request("POST", f"/v1/maps/{name}/relocalise", scan, {"Content-Type": "application/octet-stream"})
    response = connection.getresponse()
    answer = json.loads(response.read())
    connection.close()
    if response.status != 200:
        raise RuntimeError(f"relocalise: {response.status} {answer}")
    answer.pop("time_ms")
    return time.perf_counter() - begun, answer


def together(options, database, folder, count, timeout="600"):
    """Servers that search together, which know each other's ports before they start."""
    servers = [Server(options.cellmapd, database.address, folder / "data", log=folder / f"{count}-{i}.log") for i in range(count)]
    urls = [f"http://127.0.0.1:{server.port}" for server in servers]
    for server, url in zip(servers, urls):
        if count > 1:
            server.command += ["--place-servers", ",".join(urls), "--place-self", url, "--place-timeout", timeout]
        server.start()
    return servers


def asked(servers, name, scan):
    """What a query costs, and what each server keeps."""
    first, answer = ask(servers[0], name, scan)
    for _ in range(2):  # all have read what is theirs
        ask(servers[0], name, scan)
    before = [processor_s(server.process.pid) for server in servers]
    times = [ask(servers[0], name, scan)[0] for _ in range(QUERIES)]
    spent = [(processor_s(server.process.pid) - at) / QUERIES for server, at in zip(servers, before)]
    answers = [ask(server, name, scan)[1] for server in servers[1:]]
    row = {"first_s": first, "p50_s": percentile(times, 0.5), "processor_s": spent,
           "place_mib": [metric(server, "cellmap_place_bytes") / 2**20 for server in servers],
           "memory_mib": [memory_mib(server.process.pid, "VmRSS") for server in servers],
           "failed": sum(metric(server, 'cellmap_place_searches_total outcome="failed"') for server in servers)}
    return row, answer, [f"server {i + 1} of {len(servers)} answers otherwise" for i, other in enumerate(answers) if other != answer]


def hanging(options, database, folder, name, scan, expected):
    """One of three is stopped: the answers of the first are right, and how long they take."""
    servers = together(options, database, folder, 3, timeout="2")
    try:
        for _ in range(3):  # all have read what is theirs
            ask(servers[0], name, scan)
            time.sleep(6)  # whoever was too slow at first is asked again
        servers[2].process.send_signal(signal.SIGSTOP)
        asked = [ask(servers[0], name, scan) for _ in range(3)]
    finally:
        for server in servers:
            server.kill()
    wrong = ["an answer is another one while a server hangs"] if any(answer != expected for _, answer in asked) else []
    return [took for took, _ in asked], wrong


def measured(options, database, folder, name, cells, scan):
    rows, wrong, expected = {}, [], None
    for count in (1, 2, 3):
        servers = together(options, database, folder, count)
        try:
            row, answer, others = asked(servers, name, scan)
            wrong += others
            expected = expected or answer
            if answer != expected or answer["cells_considered"] != cells:
                wrong.append(f"{name}: {count} servers answer {answer}, one {expected}")
            if row["failed"]:
                wrong.append(f"{name}: {row['failed']} searches failed among {count} servers")
            whole = rows.get(1, row)["place_mib"][0]
            if not 0.95 * whole < sum(row["place_mib"]) < 1.05 * whole or max(row["place_mib"]) > 2 * whole / count:
                wrong.append(f"{name}: {count} servers keep {row['place_mib']} MiB, one {whole}")
            rows[count] = row
            note(f"place-servers, {cells} CELLs, {count}: first query {row['first_s']:.2f} s, then {row['p50_s']:.3f} s; processor a query "
                 f"{[round(s, 3) for s in row['processor_s']]} s; places {[round(m) for m in row['place_mib']]} MiB, in all "
                 f"{[round(m) for m in row['memory_mib']]} MiB")
        finally:
            for server in servers:
                server.kill()
    return rows, expected, wrong


def run(options, folder):
    sizes = {"medium": 10_000} if options.short else {"medium": 100_000, "large": 1_000_000}
    row, wrong = {"cells": sizes}, []
    (folder / "data").mkdir()
    scan = simulated(options, folder)
    database = Cluster(shared_buffers="512MB", max_wal_size="4GB").create()
    try:
        one = one_cell(options, database, folder)
        for name, cells in sizes.items():
            fill(options, database, folder, name, cells, one)
            row[name], expected, others = measured(options, database, folder, name, cells, scan)
            wrong += others
            if name == "medium":
                row["hanging_s"], others = hanging(options, database, folder, name, scan, expected)
                wrong += others
                note(f"place-servers, one of three hangs: {', '.join(f'{s:.2f}' for s in row['hanging_s'])} s")
    finally:
        database.remove()
    row["wrong"] = wrong
    return row
