"""A database that is far away: CELLs a second of one robot's commits, of one large commit, of one that moves them, and of reading
them one by one, with statements sent together (libpq's pipeline mode) against each waiting for its answer; on this machine, and
with 1 ms and 5 ms a roundtrip. Whatever the latency, sending together must not be slower; at 5 ms it must pay."""
import json
import subprocess
from pathlib import Path

from database import Cluster
from link import Link
from support import note

DELAYS_MS = (0, 1, 5)
# Times as fast as one by one at 5 ms, at least.
MUST = {"one_a_commit": 3, "all_in_one": 20, "moved": 10, "read": 1.3}


def rates(program, address, name, cells, one_by_one):
    done = subprocess.run([program, address, name, str(cells), *(["--one-by-one"] if one_by_one else [])],
                          capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"commit_rate: {done.stderr}")
    return json.loads(done.stdout)


def compared(program, address, delay, cells):
    """CELLs a second of either way and their ratios; the two take turns."""
    best = {}
    for turn in range(3 if delay == 0 else 1):
        for way in ("one_by_one", "together"):
            found = rates(program, address, f"{way}-{delay}-{turn}", cells, way == "one_by_one")
            best[way] = {what: max(rate, best.get(way, {}).get(what, 0)) for what, rate in found.items()}
    ratio = {what: round(best["together"][what] / best["one_by_one"][what], 2) for what in MUST}
    return {way: {what: round(rate, 1) for what, rate in rates_of.items()} for way, rates_of in best.items()} | {"ratio": ratio}


def run(options, _):
    program = Path(options.cellmap).parent.parent / "tests" / "scale" / "commit_rate"
    cells = 20 if options.short else 100
    database, link, row, wrong = Cluster().create(), None, {}, []
    try:
        link = Link(database)
        for delay in DELAYS_MS:
            link.order("delay", delay / 2e3)
            told = compared(program, database.address if delay == 0 else link.address, delay, cells)
            row[f"{delay}_ms"] = told
            note(f"far-database, {delay} ms a roundtrip, CELLs/s together and times one by one: " + ", ".join(
                f"{what} {rate:.0f} (x{told['ratio'][what]})" for what, rate in told["together"].items()))
        wrong += [f"on this machine {what} is slower: x{ratio}" for what, ratio in row["0_ms"]["ratio"].items() if ratio < 0.8]
        wrong += [f"at 5 ms {what} gains x{ratio}, must {MUST[what]}" for what, ratio in row["5_ms"]["ratio"].items() if ratio < MUST[what]]
        return row | {"wrong": wrong}
    finally:
        if link:
            link.end()
        database.remove()
