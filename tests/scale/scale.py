#!/usr/bin/env python3
"""What many servers over one database bear, and what maps of a million CELLs cost. Each row is a module in rows, which says what it
does and what must hold:

server-killed   three servers behind HAProxy, then nginx: one is killed, one drained; no request fails
failover        the primary is killed, its synchronous standby promoted; no acknowledged CELL is lost
worker-killed   a worker is killed in mid-job: another one ends it, with the same bytes
two-workers     two drives by two workers against one: faster, and the same bytes
one-drive       one drive by two workers against one: the same bytes, and less to do for each
slow-database   50 ms to the database, then nothing passes: right or refused in time, and all goes on afterwards
far-database    1 and 5 ms to the database: what sending statements together gains
many-maps       1 to 8 robots that commit to as many maps, against all to one map: they do not wait for each other
object-store    the bytes of CELLs in an object store that hangs: refused in time, nothing lost, all goes on
partition       one of two servers is cut off from the database: it refuses, the other goes on, nothing is lost
full-disk       the database's disk fills up: writes are refused, reads go on, nothing is lost
unit-costs      processor time and bytes of one fetch, relocalisation, CELL, scan
capacity        10^6 synthetic CELLs in both engines: queries, changes, memory
places          what relocalisation keeps of as many: in the store, in memory, and the search for candidates
place-servers   the same shared out among 1, 2, 3 servers: memory of each, time of a query, the same answers, one of them hanging

Every row prints a line and is asserted; --json has its figures.
"""
import argparse
import importlib
import json
import os
import signal
import sys
import tempfile
import traceback
from pathlib import Path

sys.dont_write_bytecode = True
from database import programs  # noqa: E402
from support import missing, note  # noqa: E402

# What each needs beside the two programs: a database, programs, or to be root.
ROWS = {
    "server-killed": ("postgres", "haproxy", "nginx"),
    "failover": ("postgres",),
    "worker-killed": ("postgres",),
    "two-workers": ("postgres", "taskset"),
    "one-drive": ("postgres", "taskset"),
    "slow-database": ("postgres",),
    "far-database": ("postgres",),
    "many-maps": ("postgres",),
    "object-store": ("postgres", "npm"),
    "partition": ("postgres", "ip", "root"),
    "full-disk": ("postgres", "root"),
    "unit-costs": ("postgres",),
    "capacity": ("postgres",),
    "places": ("postgres",),
    "place-servers": ("postgres",),
}
SHORT = ("server-killed",)


def lacks(needs, short):
    """What is not there of what a row needs, in words."""
    if "postgres" in needs and not programs():
        yield "PostgreSQL (./install-dependencies.sh --with-postgresql)"
    if "npm" in needs and missing("node", "npm"):
        yield "Node.js 20 with npm"
    wanted = [need for need in needs if need not in ("postgres", "root", "npm") and not (short and need == "nginx")]
    for program in missing(*wanted):
        yield f"{program} (./install-dependencies.sh --with-proxies)"
    if "root" in needs and os.geteuid() != 0:
        yield "root"


def tried_row(row, options):
    """What came of it; a row that breaks off is wrong, and the others are tried."""
    with tempfile.TemporaryDirectory(prefix="cellmap-scale-") as folder:
        try:
            return importlib.import_module("rows." + row.replace("-", "_")).run(options, Path(folder))
        except Exception as failed:  # whatever a row may raise
            traceback.print_exc()
            return {"wrong": [f"it broke off: {failed!r}"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=lambda text: text.split(","), help=f"some of {','.join(ROWS)}; default: all")
    parser.add_argument("--short", action="store_true", help=f"seconds instead of minutes; by default only {','.join(SHORT)}")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    options = parser.parse_args()
    options.cellmap, options.cellmapd = (str(Path(program).resolve()) for program in (options.cellmap, options.cellmapd))
    rows = options.rows or (SHORT if options.short else list(ROWS))
    if not set(rows) <= set(ROWS):
        parser.error(f"--rows takes {','.join(ROWS)}")
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing it started goes on
    result, wrong = {"load_before": os.getloadavg(), "processors": os.cpu_count()}, []
    for row in rows:
        lacking = list(lacks(ROWS[row], options.short))
        if lacking:
            note(f"NOT TRIED: {row}; it takes {', '.join(lacking)}")
            continue
        result[row] = tried_row(row, options)
        wrong += [f"{row}: {line}" for line in result[row]["wrong"]]
    result["load_after"] = os.getloadavg()
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    for line in wrong:
        print("WRONG:", line)
    tried = [row for row in rows if row in result]
    return 1 if wrong else 0 if tried else 77


if __name__ == "__main__":
    sys.exit(main())
