"""Those that write while the server is killed. Each knows what was acknowledged to it and what it was waiting for."""
import hashlib
import random
import subprocess
import threading
import time

from server import Lost, Refused

CELL = "application/vnd.cellmap.cell"
ARCHIVE = "application/vnd.cellmap.archive"


class Violation(Exception):
    """Something that was promised does not hold."""


def require(holds, what):
    if not holds:
        raise Violation(what)


def content(api, name):
    """What two maps have in common that are the same but for the numbers of their CELLs and constraints: every bit of what a
    client can see of CELLs, poses and constraints."""
    cells = api.get(f"/v1/maps/{name}/cells?limit=10000")["cells"]
    label = {cell["id"]: (cell["session"], cell["sequence"]) for cell in cells}
    graph = api.get(f"/v1/maps/{name}/pose-graph")
    nodes = {label[node["id"]]: node["pose"] for node in graph["nodes"]}
    return {
        "cells": sorted((label[c["id"]], c["hash"], c["planes"], c["bytes"]) for c in cells),
        "poses": sorted(nodes.items()),
        "unaligned": sorted(label[cell] for cell in graph["unaligned"]),
        "constraints": sorted((label[c["from"]], label[c["to"]], c["kind"], c["pose"], c["weight"], c["information"])
                              for c in graph["constraints"]),
    }


def require_same(found, expected, what):
    for part in expected:
        require(len(found[part]) == len(expected[part]), f"{what}: {len(found[part])} {part} instead of {len(expected[part])}")
        for a, b in zip(found[part], expected[part]):
            require(a == b, f"{what}: {part}: {str(a)[:300]} instead of {str(b)[:300]}")


def content_hash(data, claimed):
    """FORMAT.md: SHA-256 of a CELL's bytes with its hash field, which is in them, set to zero."""
    return hashlib.sha256(data.replace(bytes.fromhex(claimed), bytes(32), 1)).hexdigest()


def require_bytes(api, name, cells):
    """The bytes of these CELLs are those that their hashes say."""
    for cell in cells:
        data = api.call("GET", f"/v1/maps/{name}/cells/{cell['id']}", accept=CELL)
        digest = content_hash(data, cell["hash"])
        require(digest == cell["hash"], f"CELL {cell['id']} of {name} has hash {digest} instead of {cell['hash']}")


def require_readable_history(api, name, rng):
    """Every revision can be read; looks at three of them."""
    now = api.get(f"/v1/maps/{name}")["revision"]
    for revision in {rng.randint(0, now) for _ in range(3)} | {now}:
        try:
            graph = api.get(f"/v1/maps/{name}/pose-graph?revision={revision}")
        except Refused as refused:
            require(refused.status == 404 and name == "cells", f"revision {revision} of {name} cannot be read: {refused}")
            continue  # a removed session took its history along
        require(graph["revision"] == revision, f"revision {revision} of {name} says that it is {graph['revision']}")


class Writer(threading.Thread):
    """Does one thing after the other while the world is open."""

    def __init__(self, world, seed):
        super().__init__(daemon=True)
        self.world, self.rng = world, random.Random(seed)
        self.began = threading.Event()
        self.acknowledged = 0

    def run(self):
        lost = 0
        while now := self.world.enter(lost):
            try:
                self.began.set()
                self.step(self.world.api)
            except Lost:
                lost = now  # what became of it is for `verify` to see, before anything else is done
            except Refused as refused:
                if refused.status != 503:  # busy, or on its way down: nothing happened
                    self.world.violations.append(f"{type(self).__name__}: {refused}")
            except Violation as violation:
                self.world.violations.append(f"{type(self).__name__}: {violation}")
            finally:
                self.world.leave()

    def step(self, api):
        raise NotImplementedError

    def verify(self, api):
        """Called when the server is there again and nobody writes."""

    def finish(self, api):
        """Called at the end, when the server will not be killed again."""

    def close(self):
        """Leaves nothing running."""


class CellWriter(Writer):
    """Sends a drive CELL by CELL, deletes its session, begins again."""

    def __init__(self, world, seed, cells, expected):
        super().__init__(world, seed)
        self.cells, self.expected = cells, expected  # [(hash, bytes)], content when all are there
        self.ids, self.revision, self.pending = [], 0, None

    def step(self, api):
        if len(self.ids) < len(self.cells):
            digest, data = self.cells[len(self.ids)]
            self.pending = "put"
            answer = api.call("PUT", f"/v1/maps/cells/sessions/up/cells/{digest}", data, CELL)
            self.pending = None
            answer = self.world.json(answer)
            require(answer["hash"] == digest, "the answer to a CELL names another")
            self.ids.append(answer["id"])
            self.revision = answer["revision"]
        else:
            require_same(content(api, "cells"), self.expected, "CELL by CELL")
            self.pending = "delete"
            api.call("DELETE", "/v1/maps/cells/sessions/up")
            self.pending = None
            self.ids, self.revision = [], self.revision + 1
        self.acknowledged += 1

    def verify(self, api):
        listed = api.get("/v1/maps/cells/cells?limit=10000")["cells"]
        revision = api.get("/v1/maps/cells")["revision"]
        if self.pending == "put" and len(listed) == len(self.ids) + 1:
            self.ids.append(listed[-1]["id"])
            self.revision += 1
        if self.pending == "delete" and not listed:
            self.ids, self.revision = [], self.revision + 1
        self.pending = None
        require([c["id"] for c in listed] == self.ids, f"CELLs {[c['id'] for c in listed]} instead of the acknowledged {self.ids}")
        require([c["hash"] for c in listed] == [digest for digest, _ in self.cells[:len(listed)]], "CELLs are not those that were sent")
        require(revision == self.revision, f"map cells is at revision {revision} instead of {self.revision}")
        require_bytes(api, "cells", listed)
        require_readable_history(api, "cells", self.rng)


class LoopWriter(Writer):
    """Adds measured loops, pins them, and takes them back."""

    def __init__(self, world, seed):
        super().__init__(world, seed)
        self.cells = [cell["id"] for cell in world.api.get("/v1/maps/loops/cells")["cells"]]
        self.loops, self.revision, self.pending = {}, world.api.get("/v1/maps/loops")["revision"], None

    def step(self, api):
        kind = self.rng.choice(["add", "pin", "take"] if self.loops else ["add"])
        if len(self.loops) > 8:
            kind = "take"
        loop = self.rng.choice(sorted(self.loops)) if self.loops else None
        if kind == "add":
            a, b = self.rng.sample(self.cells, 2)
            pose = [round(self.rng.uniform(-5, 5), 6) for _ in range(3)] + [0, 0, 0, 1]
            self.pending = ("add", (a, b, pose[:3]))
            answer = api.send("POST", "/v1/maps/loops/loops", {"from": a, "to": b, "pose": pose})
            self.loops[answer["loops"][0]["id"]] = ((a, b, pose[:3]), False)
        elif kind == "pin":
            measured, pinned = self.loops[loop]
            self.pending = ("pin", loop)
            answer = api.send("PATCH", f"/v1/maps/loops/loops/{loop}", {"pinned": not pinned})
            self.loops[loop] = (measured, not pinned)
        else:
            self.pending = ("take", loop)
            answer = api.send("DELETE", f"/v1/maps/loops/loops/{loop}")
            del self.loops[loop]
        require(answer["revision"] == self.revision + 1, f"revision {answer['revision']} follows {self.revision}")
        self.revision, self.pending = answer["revision"], None
        self.acknowledged += 1

    def verify(self, api):
        listed = {c["id"]: ((c["from"], c["to"], c["pose"][:3]), c["pinned"])
                  for c in api.get("/v1/maps/loops/loops")["loops"] if c["origin"] == "user"}
        revision = api.get("/v1/maps/loops")["revision"]
        if self.pending and revision == self.revision + 1:  # it happened, so it happened whole
            kind, what = self.pending
            if kind == "add":
                new = [loop for loop in listed if loop not in self.loops]
                require(len(new) == 1 and listed[new[0]] == (what, False), f"of an unanswered loop came {[listed[n] for n in new]}")
                self.loops[new[0]] = listed[new[0]]
            elif kind == "pin":
                self.loops[what] = (self.loops[what][0], not self.loops[what][1])
            else:
                del self.loops[what]
            self.revision = revision
        self.pending = None
        require(revision == self.revision, f"map loops is at revision {revision} instead of {self.revision}")
        require(listed == self.loops, f"loops {listed} instead of the acknowledged {self.loops}")
        require_readable_history(api, "loops", self.rng)


class PlaceWriter(Writer):
    """Says again and again where a map lies on Earth: one value replaces another, outside of revisions."""

    def __init__(self, world, seed):
        super().__init__(world, seed)
        self.height, self.pending = None, None

    def step(self, api):
        self.pending = self.rng.randint(0, 90000)
        api.send("PUT", "/v1/maps/loops/georeference",
                 {"latitude_deg": 48, "longitude_deg": 9, "height_m": self.pending, "q_enu_map": [0, 0, 0, 1]})
        self.height, self.pending = self.pending, None
        self.acknowledged += 1

    def verify(self, api):
        place = api.get("/v1/maps/loops")["georeference"]
        found = place and place["height_m"]
        require(found in (self.height, self.pending), f"height {found} instead of the acknowledged {self.height}")
        self.height, self.pending = found, None


class ArchiveWriter(Writer):
    """Puts archives and deletes the maps that they became; and splits some of them."""

    def __init__(self, world, seed, archive, expected):
        super().__init__(world, seed)
        self.archive, self.expected = archive, expected
        self.there, self.pending, self.count = set(), None, 0

    def step(self, api):
        if len(self.there) < 2:
            self.count += 1
            name = f"arch{self.count}"
            self.pending = ("put", name)
            api.call("PUT", f"/v1/maps/{name}/archive", self.archive, ARCHIVE)
            self.there.add(name)
        else:
            name = min(self.there)
            self.pending = ("delete", name)
            api.call("DELETE", f"/v1/maps/{name}")
            self.there.discard(name)
        self.pending = None
        self.acknowledged += 1

    def verify(self, api):
        listed = {m["name"] for m in api.get("/v1/maps")["maps"] if m["name"].startswith("arch")}
        if self.pending:
            kind, name = self.pending
            if kind == "put" and name in listed:
                self.there.add(name)
            if kind == "delete" and name not in listed:
                self.there.discard(name)
        self.pending = None
        require(listed == self.there, f"maps {sorted(listed)} instead of the acknowledged {sorted(self.there)}")
        for name in listed:
            require_same(content(api, name), self.expected, name)


class SplitWriter(Writer):
    """Moves a session out of a map into one of its own: never in both, never in neither."""

    def __init__(self, world, seed, archive):
        super().__init__(world, seed)
        self.archive, self.split = archive, False

    def sessions(self, api, name):
        try:
            return set(api.get(f"/v1/maps/{name}")["sessions"])
        except Refused as refused:
            require(refused.status == 404, str(refused))
            return None

    def step(self, api):
        if self.sessions(api, "whole") is None:
            api.call("PUT", "/v1/maps/whole/archive", self.archive, ARCHIVE)
        elif not self.split:
            api.send("POST", "/v1/maps/whole/split", {"sessions": ["second"], "into": "part"})
            self.split = True
        else:
            self.split = None  # before: a deletion whose answer was lost may have been carried out
            api.call("DELETE", "/v1/maps/part")
            api.call("DELETE", "/v1/maps/whole")
            self.split = False
        self.acknowledged += 1

    def verify(self, api):
        whole, part = self.sessions(api, "whole"), self.sessions(api, "part")
        require((whole, part) in ((None, None), ({"first", "second"}, None), ({"first"}, {"second"}), ({"first"}, None)),
                f"after a split the sessions are {whole} and {part}")
        if self.split:
            require(part == {"second"}, "an acknowledged split is gone")
        self.split = whole == {"first"} and part is not None
        if whole == {"first"} and part is None:  # between the two deletions
            api.call("DELETE", "/v1/maps/whole")


class JobWriter(Writer):
    """Asks for a job on a new map, waits for it, and compares the map with that of an undisturbed run."""

    def __init__(self, world, seed, prefix, expected):
        super().__init__(world, seed)
        self.prefix, self.expected = prefix, expected
        self.map, self.job, self.count, self.cells_seen, self.compared = None, None, 0, 0, 0

    def begin(self, api):
        raise NotImplementedError

    def step(self, api):
        if self.map is None:
            self.count += 1
            self.map, self.cells_seen = f"{self.prefix}{self.count}", 0
        if self.job is None:
            self.job = self.begin(api)["id"]
            self.acknowledged += 1
        job = api.get(f"/v1/jobs/{self.job}")
        require(job["state"] in ("queued", "running", "succeeded"), f"job {self.job} is {job['state']}: {job['error']}")
        self.cells_seen = max(self.cells_seen, api.get(f"/v1/maps/{self.map}")["cells"])
        if job["state"] != "succeeded":
            time.sleep(0.01)
            return
        require_same(content(api, self.map), self.expected, f"{self.map} after its job")
        self.compared += 1
        api.call("DELETE", f"/v1/maps/{self.map}")
        self.map = self.job = None

    def verify(self, api):
        if self.job is not None:
            job = api.get(f"/v1/jobs/{self.job}")
            require(job["state"] in ("queued", "running", "succeeded"), f"job {self.job} is {job['state']}: {job['error']}")
            try:
                cells = api.get(f"/v1/maps/{self.map}/cells?limit=10000")["cells"]
            except Refused as refused:  # it was being deleted
                require(refused.status == 404 and job["state"] == "succeeded", f"{self.map}: {refused}")
                self.map = self.job = None
                return
            require(len(cells) >= self.cells_seen, f"{self.map} had {self.cells_seen} CELLs and has {len(cells)}")
            require_bytes(api, self.map, cells)
            require_readable_history(api, self.map, self.rng)

    def finish(self, api):
        while self.job is not None and not self.world.violations:
            self.step(api)


class IngestWriter(JobWriter):
    """The server reads a drive from a path."""

    def begin(self, api):
        return api.send("POST", f"/v1/maps/{self.map}/jobs",
                        {"kind": "ingest", "path": "drive", "session": "first", "create_map": True})


class MergeWriter(JobWriter):
    """Copies all sessions of map pair into a new map."""

    def begin(self, api):
        try:
            api.send("POST", "/v1/maps", {"name": self.map, "lattice": self.world.lattice})
        except Refused as refused:
            require(refused.status == 409, str(refused))
        unfinished = [job for job in api.get(f"/v1/maps/{self.map}/jobs")["jobs"]]
        return unfinished[0] if unfinished else api.send("POST", f"/v1/maps/{self.map}/merge", {"from": "pair"})


class RobotWriter(Writer):
    """`cellmap ingest` as a robot runs it, which waits for a lost server and goes on; begun again where it met none."""

    def __init__(self, world, seed, expected):
        super().__init__(world, seed)
        self.expected, self.process, self.map, self.count, self.compared = expected, None, None, 0, 0

    def step(self, api):
        if self.process is None:
            self.count += 1
            self.map = f"robot{self.count}"
            self.process = subprocess.Popen(
                [self.world.cellmap, "ingest", str(self.world.drive), "--session", "first", "--server",
                 f"http://127.0.0.1:{api.port}", "--map", self.map, "--reconnect", "120", "--json"],
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        if self.process.poll() is None:
            time.sleep(0.02)
            return
        said = self.process.stderr.read().decode()
        code, self.process = self.process.returncode, None
        if "cannot reach the server" in said:  # it began while there was none, and takes that for a wrong address
            return
        require(code == 0, f"cellmap ingest ended with {code}: {said[-500:]}")
        require_same(content(api, self.map), self.expected, f"{self.map} that a robot sent")
        self.compared += 1
        self.acknowledged += 1
        api.call("DELETE", f"/v1/maps/{self.map}")

    def finish(self, api):
        while self.process is not None and not self.world.violations:
            self.step(api)

    def close(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()


class Watcher(Writer):
    """Writes nothing: looks all the time for maps that are seen before they are whole."""

    def __init__(self, world, seed, expected):
        super().__init__(world, seed)
        self.expected = expected

    def step(self, api):
        for info in api.get("/v1/maps")["maps"]:
            require(not info["name"].startswith("."), f"map {info['name']} is none of ours")
            if info["name"].startswith("arch"):
                found = (info["cells"], info["constraints"])
                require(found == (len(self.expected["cells"]), len(self.expected["constraints"])),
                        f"{info['name']} was seen with {found[0]} CELLs and {found[1]} constraints")
        time.sleep(0.005)
