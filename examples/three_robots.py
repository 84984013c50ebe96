#!/usr/bin/env python3
"""Three robots map one simulated town at the same time; one server makes one map of it.

Each robot starts somewhere else on the route, a little later than the one before it, and knows nothing of the others. All
is done by processes of `cellmap` against one `cellmapd`: robots send CELLs instead of scans, a follower keeps a copy of
the map. Prints what went over the wire, beside what the raw scans and sending the map again would have been, and how far
the map is from the truth, beside that of one robot that drove it all.
Usage: three_robots.py [--folder FOLDER] [--first-day N] [--small] [--check] [--cellmap FILE] [--cellmapd FILE]
"""
import argparse
import hashlib
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

# First scan and number of scans of each robot's part of the route.
TOWN = {"scans": 560, "parts": [(0, 260), (180, 260), (360, 200)], "simulate": ["--route", "town"]}
# Once and a half around a block, a scan every 1.5 m, seen by a thin LiDAR: seconds instead of minutes.
BLOCK = {"scans": 138, "parts": [(0, 62), (38, 62), (76, 62)], "simulate": ["--columns", "500", "--route-frame", "sensor"]}


class Programs:
    def __init__(self, cellmap, cellmapd, folder):
        self.cellmap, self.cellmapd, self.folder = cellmap, cellmapd, folder
        self.log = open(folder / "log.txt", "ab")

    def start(self, *arguments):
        return subprocess.Popen([self.cellmap, *map(str, arguments), "--json"], stdout=subprocess.PIPE, stderr=self.log)

    def finish(self, process):
        out, _ = process.communicate()
        if process.returncode != 0:
            sys.exit(f"{' '.join(process.args)}\nended with {process.returncode}: {out.decode()}; see {self.folder}/log.txt")
        return json.loads(out)

    def run(self, *arguments):
        return self.finish(self.start(*arguments))


class Server:
    """A cellmapd of its own store, and what HTTP tells about its map."""

    def __init__(self, programs):
        out = programs.folder / "server.out"
        with open(out, "wb") as file:
            self.process = subprocess.Popen(
                [programs.cellmapd, "--store", programs.folder / "store.db", "--listen", "127.0.0.1:0"],
                stdout=file, stderr=programs.log)
        self.url = None
        while not self.url:
            if self.process.poll() is not None:
                sys.exit(f"cellmapd ended; see {programs.folder}/log.txt")
            time.sleep(0.05)
            found = re.search(r"http://[\d.:]+\d", out.read_text())
            self.url = found and found.group()

    def get(self, path, accept="application/json", coding="identity"):
        request = urllib.request.Request(self.url + path, headers={"Accept": accept, "Accept-Encoding": coding})
        with urllib.request.urlopen(request) as answer:
            return answer.read()

    def json(self, path):
        return json.loads(self.get(path))

    def bytes_on_the_wire(self, path, media_type):
        return len(self.get(path, media_type, "zstd"))

    def cells(self, name):
        """Hash of each CELL's bytes, which must stay for ever."""
        page = self.json(f"/v1/maps/{name}/cells?limit=10000")
        return {cell["id"]: hashlib.sha256(self.get(f"/v1/maps/{name}/cells/{cell['id']}", "application/vnd.cellmap.cell")).hexdigest()
                for cell in page["cells"]}


def write_block(file, scans, step=1.5, radius=22.0):
    """Poses along a circle, in KITTI's format."""
    with open(file, "w", encoding="utf-8") as out:
        for i in range(scans):
            a = i * step / radius
            c, s = math.cos(a), math.sin(a)
            out.write(f"{c} {-s} 0 {radius * s} {s} {c} 0 {radius * (1 - c)} 0 0 1 0\n")


def simulate(programs, world, first_day):
    """One town, three days: each robot sees other cars, and has other noise."""
    arguments = list(world["simulate"])
    if world is BLOCK:
        write_block(programs.folder / "route.txt", world["scans"])
        arguments += ["--route", programs.folder / "route.txt"]
    for day in (1, 2, 3):
        out = programs.folder / f"day{day}"
        if not out.exists():
            programs.run("simulate", *arguments, "--scans", world["scans"], "--traffic-seed", first_day + day - 1, "--out", out)


def wait_for_cells(server, session, count):
    while True:
        found = [s["cells"] for s in server.json("/v1/maps/town/sessions")["sessions"] if s["name"] == session]
        if found and found[0] >= count:
            return
        time.sleep(0.05)


def drive_all(programs, server, world):
    """The mission; returns what each robot printed, and the bytes of CELLs as they were on the way."""
    robots, seen = [], {}
    for number, (first, scans) in enumerate(world["parts"], 1):
        robots.append(programs.start(
            "ingest", programs.folder / f"day{number}", "--cells", "--robot", f"cart-{number}", "--session", f"robot{number}",
            "--first-scan", first, "--scans", scans, "--server", server.url, "--map", "town"))
        if number < len(world["parts"]):
            wait_for_cells(server, f"robot{number}", 3)
            seen |= server.cells("town")
    return [programs.finish(robot) for robot in robots], seen


def kitti_row(pose):
    """[x, y, z, qx, qy, qz, qw] as a row of 3 x 4 numbers."""
    x, y, z, i, j, k, w = pose
    return " ".join(map(repr, (
        1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w), x,
        2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), y,
        2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j), z)))


def cells_and_truth(server, name, first_scans, truth):
    """Where a map puts its CELLs, and where their first scans were taken."""
    estimate, true = [], []
    for cell in server.json(f"/v1/maps/{name}/cells?limit=10000")["cells"]:
        first_scan = server.json(f"/v1/maps/{name}/cells/{cell['id']}")["first_scan"]
        estimate.append(kitti_row(cell["pose"]))
        true.append(truth[first_scans[cell["session"]] + first_scan])
    return estimate, true


def ape(programs, label, estimate, truth):
    """Absolute position error, RMSE in metres, after one rigid alignment of all."""
    for name, lines in (("estimate", estimate), ("truth", truth)):
        (programs.folder / f"{label}-{name}.txt").write_text("\n".join(lines) + "\n")
    return programs.run("evaluate", "trajectory", "--estimate", programs.folder / f"{label}-estimate.txt",
                        "--truth", programs.folder / f"{label}-truth.txt")["ape_rmse_m"]


def accuracy(programs, server, world):
    """Position error of the CELLs of all robots, in one frame, and of a robot's that drove the whole route in one session."""
    programs.run("ingest", programs.folder / "day1", "--cells", "--session", "alone", "--server", server.url, "--map", "alone")
    truth = (programs.folder / "day1" / "poses_gt.txt").read_text().splitlines()
    first_scans = {f"robot{number}": first for number, (first, _) in enumerate(world["parts"], 1)}
    return (ape(programs, "together", *cells_and_truth(server, "town", first_scans, truth)),
            ape(programs, "alone", *cells_and_truth(server, "alone", {"alone": 0}, truth)))


def bytes_of_sending_the_map_again(server):
    """Of all CELLs and the pose graph, at every revision that closed a loop; and how many those were."""
    wire = {cell["id"]: server.bytes_on_the_wire(f"/v1/maps/town/cells/{cell['id']}", "application/vnd.cellmap.cell")
            for cell in server.json("/v1/maps/town/cells?limit=10000")["cells"]}
    total, closures, loops_before = 0, 0, 0
    for revision in range(1, server.json("/v1/maps/town")["revision"] + 1):
        path = f"/v1/maps/town/pose-graph?revision={revision}"
        graph = server.json(path)
        loops = sum(constraint["kind"] == "loop" for constraint in graph["constraints"])
        if loops > loops_before:
            closures += 1
            total += sum(wire[node["id"]] for node in graph["nodes"])
            total += server.bytes_on_the_wire(path, "application/vnd.cellmap.pose-graph")
        loops_before = loops
    return total, closures


def follow(programs, server):
    return programs.start("pull", "town", programs.folder / "mirror", "--server", server.url, "--follow")


def end_following(follower, revision):
    """What the follower received on its way to this revision."""
    updates = []
    while not updates or updates[-1]["revision"] < revision:
        updates.append(json.loads(follower.stdout.readline()))
    follower.send_signal(signal.SIGTERM)
    follower.wait()
    return updates


def megabytes(count):
    return f"{count / 1e6:10.3f}"


def print_table(robots, updates, again, closures):
    received = sum(update["received_bytes"] for update in updates)
    print(f"\n{'':24}{'km':>8}{'MB up':>11}{'MB down':>11}{'MB up/km':>11}{'MB down/km':>11}{'raw MB/km':>11}")
    for number, robot in enumerate(robots, 1):
        km = robot["length_m"] / 1000
        print(f"robot {number} sends{'':11}{km:8.3f} {megabytes(robot['sent_bytes'])} {megabytes(robot['received_bytes'])} "
              f"{megabytes(robot['sent_bytes'] / km)} {megabytes(robot['received_bytes'] / km)} {megabytes(robot['raw_scan_bytes'] / km)}")
    km = sum(robot["length_m"] for robot in robots) / 1000
    print(f"the map to a follower   {km:8.3f}{'':12}{megabytes(received)}{'':12}{megabytes(received / km)}")
    print(f"the map again, at each of {closures} revisions that closed a loop: {again / 1e6:.3f} MB; "
          f"following took {received / 1e6:.3f} MB, {again / received:.1f} times less")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where drives and store go (default: a temporary one)")
    parser.add_argument("--first-day", type=int, default=1, help="of three: other cars, other noise")
    parser.add_argument("--small", action="store_true", help="around a block instead of through a town")
    parser.add_argument("--check", action="store_true", help="fail where the map is not as it must be")
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        programs = Programs(options.cellmap, options.cellmapd, folder)
        world = BLOCK if options.small else TOWN
        simulate(programs, world, options.first_day)
        server = Server(programs)
        follower = None
        try:
            programs.run("maps", "create", "town", "--server", server.url)
            follower = follow(programs, server)
            begun = time.monotonic()
            robots, seen = drive_all(programs, server, world)
            print(f"{time.monotonic() - begun:.1f} s")
            failures = report(programs, server, world, robots, seen, follower)
            for failure in failures:
                print("NOT AS IT MUST BE:", failure)
            return 1 if failures and options.check else 0
        finally:
            for process in filter(None, (follower, server.process)):
                process.kill()
                process.wait()


def report(programs, server, world, robots, seen, follower):
    """Prints what became of the mission; returns what is not as it must be."""
    info = server.json("/v1/maps/town")
    updates = end_following(follower, info["revision"])
    sessions = server.json("/v1/maps/town/sessions")["sessions"]
    for session in sessions:
        where = "in the map frame" if session["aligned"] else "not aligned"
        print(f"{session['name']}: {session['cells']} CELLs, {where}")
    again, closures = bytes_of_sending_the_map_again(server)
    print_table(robots, updates, again, closures)
    together, alone = accuracy(programs, server, world)
    print(f"position error of the CELLs (RMSE): {together:.3f} m of three robots, {alone:.3f} m of one that drove it all")
    now = server.cells("town")
    received = sum(update["received_bytes"] for update in updates)
    musts = {
        "a session is not in the map frame": all(session["aligned"] for session in sessions),
        "a CELL changed": bool(seen) and all(now[cell] == digest for cell, digest in seen.items()),
        "no loop was closed": closures > 0 and sum(update["moved"] for update in updates) > 0,
        "the follower fetched a CELL twice": sum(update["fetched"] for update in updates) == len(now),
        "following took more than a tenth of sending the map again": received < again / 10,
        "CELLs took more than a tenth of the scans": all(r["sent_bytes"] < r["raw_scan_bytes"] / 10 for r in robots),
        "the position error is over 1.1 times that of one robot, and over 5 mm more": together < max(1.1 * alone, alone + 0.005),
    }
    return [failure for failure, holds in musts.items() if not holds]


if __name__ == "__main__":
    sys.exit(main())
