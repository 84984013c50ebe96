"""What a map of a million synthetic CELLs costs on both engines: radius queries in the engine, by the SQL of the product; `changes`
of a map of 10^5 CELLs after a loop that moved 100 of them, as a client receives it; memory of a server that reads such maps. (To
find the place of a scan among as many invented CELLs: `cellmap evaluate relocalisation --map-cells 100000`.)"""
import http.client
import random
import re
import sqlite3
import time
from contextlib import closing

import synthetic_map
from database import Cluster
from support import TESTS, Server, memory_mib, note, percentile, processor_s

QUERIES = 300
CHANGES = "application/vnd.cellmap.changes"


def product_sql():
    """The statement by which sql_cells.cpp finds the CELLs of a box, read from there."""
    source = (TESTS.parent / "lib" / "cellmap" / "store" / "sql_cells.cpp").read_text()
    joined = re.sub(r'"\s*\n\s*"', "", source)
    return re.search(r'"(WITH RECURSIVE grid_column.*?)"', joined).group(1)


def questions(cells, radius_m):
    """Map, borders of columns and rows of the grid for places all over the map, as `cells_in_box` binds them."""
    rng, long = random.Random(7), synthetic_map.streets(cells)
    for _ in range(QUERIES):
        i = rng.randrange(cells)
        along, street, half = 6.44 * (i % long), i // long, cells // long // 2
        x, y = (along, 100.0 * street) if street < half else (100.0 * (street - half), along)
        column = [int((at + offset) // synthetic_map.GRID_M) for at in (x, y) for offset in (-radius_m, radius_m)]
        yield column[0], column[1], column[2], column[3]


def in_sqlite(file, cells, radius_m):
    """Milliseconds of each query, through Python's binding, which makes a tuple of each row."""
    sql, times, found = product_sql(), [], 0
    with closing(sqlite3.connect(file)) as database:
        key = database.execute("SELECT id FROM map WHERE name = 'large'").fetchone()[0]
        for west, east, south, north in list(questions(cells, radius_m)) * 2:
            begun = time.perf_counter()
            found += len(database.execute(sql, (west, east, key, south, north)).fetchall())
            times.append((time.perf_counter() - begun) * 1e3)
    return times[QUERIES:], found / len(times)


def in_postgres(database, cells, radius_m):
    """As PostgreSQL itself counts them: planning and execution of the prepared statement."""
    numbers = iter(range(1, 9))
    sql = re.sub(r"\?", lambda _: f"${next(numbers)}", product_sql())
    key = database.sql("SELECT id FROM map WHERE name = 'large'")
    script = f"PREPARE q (bigint, bigint, bigint, bigint, bigint) AS {sql};\n" + "".join(
        f"EXPLAIN (ANALYZE, TIMING OFF, FORMAT JSON) EXECUTE q ({west}, {east}, {key}, {south}, {north});\n"
        for west, east, south, north in list(questions(cells, radius_m)) * 2)
    plans = re.findall(r'"Planning Time": ([\d.]+).*?"Execution Time": ([\d.]+)', database.script(script), flags=re.S)
    return [float(planning) + float(execution) for planning, execution in plans[QUERIES:]]


def fill_sqlite(options, file, folder, sizes):
    with_maps(Server(options.cellmapd, file, folder / "data", log=folder / "fill.log"), sizes)
    with closing(sqlite3.connect(file, isolation_level=None)) as database:
        database.execute("PRAGMA synchronous = OFF")
        for name, cells in sizes.items():
            database.execute("BEGIN")
            for statement in (*synthetic_map.filling(name, cells, True), *synthetic_map.closing_a_loop(name, cells, 100, True)):
                database.execute(statement)
            database.execute("COMMIT")


def fill_postgres(options, database, folder, sizes):
    with_maps(Server(options.cellmapd, database.address, folder / "data", log=folder / "fill.log"), sizes)
    for name, cells in sizes.items():
        statements = (*synthetic_map.filling(name, cells, False), *synthetic_map.closing_a_loop(name, cells, 100, False))
        database.script("SET session_replication_role = replica;\nBEGIN;\n" + ";\n".join(statements) + ";\nCOMMIT;\n")
    database.sql("VACUUM ANALYZE")


def with_maps(server, names):
    """Made by the product: the tables, and these maps."""
    try:
        server.start()
        for name in names:
            server.api.send("POST", "/v1/maps", {"name": name})
    finally:
        server.stop()


class Client:
    """One kept connection."""

    def __init__(self, server):
        self.server, self.connection = server, http.client.HTTPConnection("127.0.0.1", server.port, timeout=600)

    def ask(self, path, accept):
        """Milliseconds from the request to the last byte, processor milliseconds of the server, and bytes as they came."""
        before, begun = processor_s(self.server.process.pid), time.perf_counter()
        self.connection.request("GET", path, headers={"Accept": accept, "Accept-Encoding": "zstd"})
        answer = self.connection.getresponse()
        data = answer.read()
        took = (time.perf_counter() - begun) * 1e3
        if answer.status != 200:
            raise RuntimeError(f"{path}: {answer.status} {data[:300]!r}")
        return took, (processor_s(self.server.process.pid) - before) * 1e3, len(data)

    def often(self, path, accept, times=40):
        before = processor_s(self.server.process.pid)
        asked = [self.ask(path, accept) for _ in range(times)]
        return {"p50_ms": round(percentile([took for took, _, _ in asked], 0.5), 2), "bytes": asked[0][2],
                "processor_ms": round((processor_s(self.server.process.pid) - before) * 1e3 / times, 2)}


def served(options, store, folder, sizes):
    """What a server needs for these maps, which it has not seen before."""
    server = Server(options.cellmapd, store, folder / "data", log=folder / "served.log")
    row = {}
    try:
        server.start()
        client = Client(server)
        row["memory_mib"] = {"start": memory_mib(server.process.pid, "VmRSS")}
        for name, cells in sorted(sizes.items(), key=lambda item: item[1]):
            of_map, middle = {}, f"{cells ** 0.5},{cells ** 0.5},0"
            for what, path, accept in (("info", "", "application/json"),
                                       ("radius_50m", f"/cells?near={middle}&radius=50", "application/json"),
                                       ("changes_after_a_loop", f"/changes?since={cells}", CHANGES)):
                of_map[f"{what}_first_ms"] = round(client.ask(f"/v1/maps/{name}{path}", accept)[0], 2)
                of_map[what] = client.often(f"/v1/maps/{name}{path}", accept)
            took, processor_ms, size = client.ask(f"/v1/maps/{name}/pose-graph", "application/vnd.cellmap.pose-graph")
            of_map["pose_graph"] = {"ms": round(took), "processor_ms": round(processor_ms), "bytes": size}
            row[name] = of_map
            row["memory_mib"][f"after {name}"] = memory_mib(server.process.pid, "VmRSS")
        row["memory_mib"]["highest"] = memory_mib(server.process.pid, "VmHWM")
    finally:
        server.kill()
    return row


def compared(name, engine, row, sizes, radius_ms, must_ms):
    """The line of one engine, and what misses its mark."""
    changes = row["medium"]["changes_after_a_loop"]
    note(f"capacity, {engine}: {sizes['large']} CELLs, {row['store_bytes'] / sizes['large'] / 1.1:.0f} B a CELL beside its planes; 50 m around "
         f"a place {radius_ms:.3f} ms in the engine (must {must_ms}); changes after a loop among {sizes['medium']}: {changes['p50_ms']} ms, "
         f"{changes['bytes']} B (must 20 ms, 5000 B); memory {row['memory_mib']}")
    if radius_ms >= must_ms:
        yield f"{name}: a radius query takes {radius_ms:.3f} ms in the engine"
    if changes["p50_ms"] >= 20 or changes["bytes"] >= 5000:
        yield f"{name}: changes after a loop take {changes}"


def run(options, folder):
    sizes = {"medium": 10_000, "large": 100_000} if options.short else {"medium": 100_000, "large": 1_000_000}
    row, wrong = {"cells": sizes}, []
    file, database = folder / "store.db", Cluster(shared_buffers="512MB", max_wal_size="4GB").create()
    (folder / "data").mkdir()
    try:
        fill_sqlite(options, file, folder, sizes)
        times, found = in_sqlite(file, sizes["large"], 50)
        row["sqlite"] = served(options, file, folder, sizes) | {
            "radius_50m_p50_ms": percentile(times, 0.5), "radius_50m_p99_ms": percentile(times, 0.99), "radius_50m_rows": found,
            "radius_200m_p50_ms": percentile(in_sqlite(file, sizes["large"], 200)[0], 0.5), "store_bytes": file.stat().st_size}
        wrong += compared("sqlite", "SQLite", row["sqlite"], sizes, row["sqlite"]["radius_50m_p50_ms"], 0.1)
        fill_postgres(options, database, folder, sizes)
        times = in_postgres(database, sizes["large"], 50)
        row["postgres"] = served(options, database.address, folder, sizes) | {
            "radius_50m_p50_ms": percentile(times, 0.5), "radius_50m_p99_ms": percentile(times, 0.99),
            "radius_200m_p50_ms": percentile(in_postgres(database, sizes["large"], 200), 0.5),
            "store_bytes": int(database.sql("SELECT pg_database_size('postgres')"))}
        wrong += compared("postgres", "PostgreSQL", row["postgres"], sizes, row["postgres"]["radius_50m_p50_ms"], 1)
    finally:
        database.remove()
    row["wrong"] = wrong
    return row
