"""What relocalisation keeps of a map of 10^5 and 10^6 synthetic CELLs, on both engines: descriptions of things that stand at random around
them are kept in the store by the library, read by region, and searched with memory for all of them and for a quarter. The CELLs themselves cannot be
decoded, so no pose comes of it: what is measured is the search for candidates. (The same in memory alone, beside an index that is not in
parts: `./tests/bench/run.sh --only places`.)"""
import json
import subprocess
from pathlib import Path

from database import Cluster
from rows.capacity import fill_postgres, fill_sqlite
from support import note


def measured(options, engine, store, name, size_of_store):
    program = Path(options.cellmap).parent.parent / "tests" / "bench" / "cellmap_bench"
    before = size_of_store()
    done = subprocess.run([program, "--places-of", store, name], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"cellmap_bench: {done.stderr}")
    row = json.loads(done.stdout)
    row["bytes_a_cell_in_the_store"] = (size_of_store() - before) / row["cells"]
    took = ", ".join(f"{what.replace('_', ' ')} {row[what]['s']:.2f} s ({row[what]['processor_s']:.2f} of processor)" for what in
                     ("keep", "first_search", "search", "first_search_in_a_quarter", "search_in_a_quarter"))
    note(f"places, {engine}: {row['cells']} CELLs in {row['parts']} parts, {row['memory_mib']:.0f} MiB, "
         f"{row['bytes_a_cell_in_the_store']:.0f} B a CELL in the store; {took}")
    return row


def judged(engine, rows):
    """The search finds the place by itself, or the program breaks off; here is what memory and store may take."""
    for name, row in rows.items():
        if row["memory_mib"] * 2**20 > 1300 * row["cells"]:
            yield f"{engine}, {name}: {row['memory_mib']:.0f} MiB for {row['cells']} CELLs"
        if row["first_search"]["s"] > 60e-6 * row["cells"] + 1:
            yield f"{engine}, {name}: {row['first_search']['s']:.1f} s until a server that has just started has searched all parts"


def run(options, folder):
    sizes = {"medium": 10_000, "large": 100_000} if options.short else {"medium": 100_000, "large": 1_000_000}
    row, wrong = {"cells": sizes}, []
    file, database = folder / "store.db", Cluster(shared_buffers="512MB", max_wal_size="4GB").create()
    (folder / "data").mkdir()
    try:
        fill_sqlite(options, file, folder, sizes)
        row["sqlite"] = {name: measured(options, "SQLite", str(file), name, lambda: file.stat().st_size) for name in sizes}
        file.unlink()
        fill_postgres(options, database, folder, sizes)
        row["postgres"] = {name: measured(options, "PostgreSQL", database.address, name,
                                          lambda: int(database.sql("SELECT pg_database_size('postgres')"))) for name in sizes}
        wrong += [*judged("SQLite", row["sqlite"]), *judged("PostgreSQL", row["postgres"])]
    finally:
        database.remove()
    row["wrong"] = wrong
    return row
