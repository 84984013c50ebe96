"""Robots that commit one CELL at a time, each through a server of its own: to as many maps as there are robots, against all to one
map, in turns; with the database 1 and 5 ms away, and with a synchronous standby 5 ms behind its primary. Commits to one map take
turns, those to several do not: at 5 ms eight robots must get on at least three times as fast."""
import json
import subprocess
from pathlib import Path

from database import Cluster
from link import Link
from support import note

ROBOTS = (1, 2, 4, 8)
MUST = 3  # times as many commits of eight robots, with several maps


def rate(program, address, name, cells, robots, *options):
    done = subprocess.run([program, address, name, str(cells), "--robots", str(robots), *options], capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise RuntimeError(f"commit_rate: {done.stderr}")
    return json.loads(done.stdout)["commits"]


def compared(program, address, where, cells):
    """Commits a second by the number of robots: one map, as many maps, as many maps through one server, and what that gains."""
    told = {}
    for robots in ROBOTS:
        found = {way: rate(program, address, f"{way}-{robots}-".replace("_", "-"), cells, robots, *options)
                 for way, options in (("one_map", ["--one-map"]), ("maps", []), ("one_server", ["--one-server"]))}
        ratio = round(found["maps"] / found["one_map"], 2)
        told[robots] = {way: round(commits, 1) for way, commits in found.items()} | {"ratio": ratio}
        note(f"many-maps, {where}, {robots} robots: {found['one_map']:.0f} commits/s into one map, {found['maps']:.0f} into "
             f"{robots} (x{ratio}), {found['one_server']:.0f} through one server")
    return told


def run(options, _):
    program = Path(options.cellmap).parent.parent / "tests" / "scale" / "commit_rate"
    cells = 15 if options.short else 60
    database, standby, link, row = Cluster(fsync="on").create(), None, None, {}
    try:
        link = Link(database)
        for delay in (1, 5):
            link.order("delay", delay / 2e3)
            row[f"{delay}_ms"] = compared(program, link.address, f"{delay} ms a roundtrip", cells)
        # The standby hears of the primary over the link, so each commit waits for a roundtrip.
        standby = database.standby(fsync="on")
        standby.sql(f"ALTER SYSTEM SET primary_conninfo = 'host={link.folder} user=postgres application_name=standby'")
        standby.stop()
        standby.start()
        row["standby"] = compared(program, database.address, "a standby 5 ms away", cells)
        gained = {where: told[8]["ratio"] for where, told in row.items() if where != "1_ms"}
        return row | {"wrong": [f"{where}: eight robots gain x{ratio} by as many maps, must {MUST}" for where, ratio in gained.items()
                                if ratio < MUST]}
    finally:
        if link:
            link.end()
        for cluster in (standby, database):
            if cluster:
                cluster.remove()
