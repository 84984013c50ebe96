#!/usr/bin/env python3
"""Kills cellmapd with SIGKILL at random moments while many write to it, starts it again and checks that every acknowledged
write is there, that nothing is there by half, that revisions have no gap and contents their hashes, and that jobs which were
broken off end with the same map, bit by bit, as ones that were not.

Writers (writers.py) are threads and one process of `cellmap`; a kill waits for one of them, chosen by chance, to begin
something, then for a random time, so that requests, jobs, commits and restarts are all hit. After every kill the store's file
is read by SQL of our own (store_check.py), before cellmapd sees it again.
"""
import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from server import Server
from store_check import check_store
from writers import (ARCHIVE, CELL, ArchiveWriter, CellWriter, IngestWriter, LoopWriter, MergeWriter, PlaceWriter, RobotWriter,
                     SplitWriter, Violation, Watcher, content, content_hash)

LATTICE = {"kind": "fibonacci", "size": 50000}


class World:
    """What writers share: the server, and whether it is to be written to now."""

    lattice = LATTICE
    json = staticmethod(json.loads)

    def __init__(self, server, cellmap, drive):
        self.server, self.api, self.cellmap, self.drive = server, server.api, cellmap, drive
        self.violations = []
        self.changed = threading.Condition()
        self.is_open, self.over, self.active, self.times_opened = False, False, 0, 0

    def enter(self, times_before):
        """Waits until the world is opened for more than the `times_before`-th time, and returns which time it is; None when
        it has ended."""
        with self.changed:
            self.changed.wait_for(lambda: (self.is_open and self.times_opened > times_before) or self.over)
            self.active += not self.over
            return None if self.over else self.times_opened

    def leave(self):
        with self.changed:
            self.active -= 1
            self.changed.notify_all()

    def open(self):
        with self.changed:
            self.is_open = True
            self.times_opened += 1
            self.changed.notify_all()

    def close(self):
        """Returns when nobody is in it."""
        with self.changed:
            self.is_open = False
            if not self.changed.wait_for(lambda: self.active == 0, timeout=120):
                raise RuntimeError("a writer did not notice that the server is gone")

    def end(self):
        with self.changed:
            self.over = True
            self.changed.notify_all()


def write_route(file, scans, step=1.5, radius=9.0):
    """Poses along a circle, in KITTI's format: once around and somewhat more, so that loops are closed."""
    with open(file, "w", encoding="utf-8") as out:
        for i in range(scans):
            a = i * step / radius
            c, s = math.cos(a), math.sin(a)
            out.write(f"{c} {-s} 0 {radius * s} {s} {c} 0 {radius * (1 - c)} 0 0 1 0\n")


def simulate(cellmap, folder, name, scans, seed):
    route = folder / f"{name}.txt"
    write_route(route, scans)
    subprocess.run([cellmap, "simulate", "--route", str(route), "--route-frame", "sensor", "--columns", "360", "--scans",
                    str(scans), "--traffic-seed", str(seed), "--threads", "1", "--out", str(folder / "data" / name), "--json"],
                   check=True, stdout=subprocess.DEVNULL)


def wait_for(api, job):
    while True:
        state = api.get(f"/v1/jobs/{job['id']}")
        if state["state"] not in ("queued", "running"):
            assert state["state"] == "succeeded", state
            return
        time.sleep(0.01)


class Reference:
    """What an undisturbed server makes of the same requests."""

    def __init__(self, options, folder):
        server = Server(options.cellmapd, folder / "reference.db", folder / "data")
        try:
            server.start()
            self.ask(server.api)
        finally:
            server.kill()

    def ask(self, api):
        ingest = {"kind": "ingest", "create_map": True, "lattice": LATTICE}
        for name, path, session in (("first", "drive", "first"), ("pair0", "drive", "first"), ("pair0", "second", "second"),
                                    ("up", "drive", "up")):
            wait_for(api, api.send("POST", f"/v1/maps/{name}/jobs", ingest | {"path": path, "session": session}))
        self.ingested = content(api, "first")
        self.pair = api.call("GET", "/v1/maps/pair0/archive?encoding=raw")
        api.call("PUT", "/v1/maps/pair/archive", self.pair, ARCHIVE)
        self.restored = content(api, "pair")
        api.send("POST", "/v1/maps", {"name": "merged", "lattice": LATTICE})
        wait_for(api, api.send("POST", "/v1/maps/merged/merge", {"from": "pair"}))
        self.merged = content(api, "merged")
        api.send("POST", "/v1/maps", {"name": "cells", "lattice": LATTICE})
        self.cells = []
        for cell in api.get("/v1/maps/up/cells?limit=10000")["cells"]:
            data = api.call("GET", f"/v1/maps/up/cells/{cell['id']}", accept=CELL)
            assert content_hash(data, cell["hash"]) == cell["hash"]
            api.call("PUT", f"/v1/maps/cells/sessions/up/cells/{cell['hash']}", data, CELL)
            self.cells.append((cell["hash"], data))
        self.by_cells = content(api, "cells")


def set_up(server, reference):
    """The maps that are there before the first kill."""
    server.start()
    for name in ("pair", "loops"):
        server.api.call("PUT", f"/v1/maps/{name}/archive", reference.pair, ARCHIVE)
    server.api.send("POST", "/v1/maps", {"name": "cells", "lattice": LATTICE})


def kill_at_random(rng, world, writers):
    """Some time after somebody began something; sometimes right after the start, or twice."""
    writer = rng.choice(writers)
    writer.began.clear()
    writer.began.wait(2)
    time.sleep(rng.uniform(0, rng.choice([0.005, 0.05, 0.5])))
    world.server.kill()
    while rng.random() < 0.15:  # while it recovers
        world.server.spawn()
        time.sleep(rng.uniform(0, 0.1))
        world.server.kill()


def check(world, writers, folder):
    """The file first, then what the server says of it."""
    wrong = check_store(world.server.store, folder, with_pins=("loops",))
    world.server.start()
    for writer in writers:
        try:
            writer.verify(world.api)
        except Violation as violation:
            wrong.append(f"{type(writer).__name__}: {violation}")
    return wrong


def finish(world, writers):
    """What was begun and not disturbed any more ends well."""
    for writer in writers:
        try:
            writer.finish(world.api)
        except Violation as violation:
            world.violations.append(f"{type(writer).__name__}: {violation}")
    return world.violations


def run(options, folder):
    for name, scans in (("drive", 52), ("second", 24)):
        simulate(options.cellmap, folder, name, scans, len(name))
    reference = Reference(options, folder)
    server = Server(options.cellmapd, folder / "store.db", folder / "data")
    world = World(server, options.cellmap, folder / "data" / "drive")
    rng = random.Random(options.seed)
    writers = []
    try:
        set_up(server, reference)
        writers = [
            CellWriter(world, options.seed + 1, reference.cells, reference.by_cells),
            LoopWriter(world, options.seed + 2),
            PlaceWriter(world, options.seed + 3),
            ArchiveWriter(world, options.seed + 4, reference.pair, reference.restored),
            SplitWriter(world, options.seed + 5, reference.pair),
            IngestWriter(world, options.seed + 6, "ingested", reference.ingested),
            MergeWriter(world, options.seed + 7, "merged", reference.merged),
            RobotWriter(world, options.seed + 8, reference.ingested),
            Watcher(world, options.seed + 9, reference.restored),
        ]
        for writer in writers:
            writer.start()
        return disturb(options, folder, world, writers, rng)
    finally:
        world.end()
        server.kill()
        for writer in writers:
            writer.close()


def disturb(options, folder, world, writers, rng):
    begun, kills, wrong = time.monotonic(), 0, []
    while kills < options.kills and not wrong:
        world.open()
        kill_at_random(rng, world, writers)
        kills += 1
        world.close()
        wrong = check(world, writers, folder) + world.violations
        if options.verbose or kills % 50 == 0:
            print(f"{kills} kills, {sum(w.acknowledged for w in writers)} acknowledged", flush=True)
    if not wrong:
        wrong = finish(world, writers)
        world.server.stop()
        wrong += check_store(world.server.store, folder, with_pins=("loops",), at_rest=True)
    return {
        "seed": options.seed, "kills": kills, "seconds": round(time.monotonic() - begun, 1), "wrong": wrong,
        "acknowledged": {type(w).__name__: w.acknowledged for w in writers if w.acknowledged},
        "compared_with_undisturbed": {type(w).__name__: w.compared for w in writers if hasattr(w, "compared")},
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write what was found there")
    parser.add_argument("--folder", type=Path, help="where drive and stores go, and stay (default: a temporary one)")
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        (folder / "data").mkdir(parents=True, exist_ok=True)
        result = run(options, folder)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))
    verdict = "SOMETHING IS WRONG" if result["wrong"] else "nothing acknowledged was lost, nothing is there by half"
    print(f"{result['kills']} kills, {sum(result['acknowledged'].values())} acknowledged writes: {verdict}")
    return 1 if result["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
