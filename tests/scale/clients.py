"""A fleet (tests/load/fleet.py) whose servers may die. What a client can repeat without harm it does where an answer was cut
off in its middle, which no proxy can mend, and counts it; every other error counts as a failed request. All clients share what
they have seen: an answer that is older than one that another client had before it was asked for is wrong.

Usage: clients.py FILE, as fleet.py. Prints also: requests, cut_off, repeated (writes that were sent again).
"""
import asyncio
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "load"))
from fleet import CELL, Fleet  # noqa: E402


class Clients(Fleet):
    def __init__(self, task):
        super().__init__(task)
        self.requests = self.cut_off = self.repeated = 0
        self.seen = {}  # map: the newest revision that somebody has seen
        self.there = {}  # map: CELLs that were acknowledged

    async def timed(self, role, connection, *request, **how):
        self.requests += 1
        try:
            return await super().timed(role, connection, *request, **how)
        except asyncio.IncompleteReadError as error:
            if error.expected is None:  # nothing but a part of the head
                raise
        self.cut_off += 1
        return await super().timed(role, connection, *request, **how)

    async def look(self, connection, rng):
        """What one client has seen, no client sees less of."""
        name = rng.choice([self.task["map"], *self.there])
        least = self.seen.get(name, 0), len(self.there.get(name, ()))
        data = await self.timed("look", connection, "GET", f"/v1/maps/{name}", accept="application/json")
        if data is None:
            return
        found = json.loads(data)
        if (found["revision"], found["cells"]) < least or found["cells"] < least[1]:
            self.wrong.append(f"map {name} is at {found['revision']} with {found['cells']} CELLs, somebody had seen {least}")
        self.seen[name] = max(self.seen.get(name, 0), found["revision"])
        await asyncio.sleep(0.02)

    async def uploads(self, connection, rng):
        """A drive CELL by CELL into a map of its own, each until it is acknowledged."""
        name = f"scale-{self.task['seed']}-{rng.randrange(10**9)}"
        made = json.dumps({"name": name, "lattice": self.task["lattice"]}).encode()
        await self.insist(connection, "POST", "/v1/maps", made, "application/json", fine=(201, 409))
        self.there[name] = []
        for digest, data in self.upload:
            answer = json.loads(await self.insist(connection, "PUT", f"/v1/maps/{name}/sessions/up/cells/{digest}", data, CELL))
            self.there[name].append(digest)
            self.seen[name] = max(self.seen.get(name, 0), answer["revision"])
            self.acknowledged += 1
            await asyncio.sleep(0.02)
        listed = json.loads(await self.insist(connection, "GET", f"/v1/maps/{name}/cells?limit=10000"))
        found = [cell["hash"] for cell in listed["cells"]]
        if found != self.there[name]:
            self.wrong.append(f"{len(self.there[name])} CELLs were acknowledged, {len(found)} are there: {found}")

    async def insist(self, connection, *request, fine=(200, 201)):
        """Until it is done: for what may be sent again."""
        self.requests += 1
        begun = time.monotonic()
        while time.monotonic() < begun + 30:
            try:
                status, data = await connection.ask(*request)
                if status in fine:
                    self.latencies.setdefault("upload", []).append((time.monotonic() - begun) * 1e3)
                    return data
                if status not in (502, 503, 504):
                    break
            except (OSError, asyncio.IncompleteReadError):
                pass
            self.repeated += 1
            await asyncio.sleep(0.05)
        raise OSError(f"{request[:2]} was not answered in 30 s, or refused")

    async def run(self):
        return {**await super().run(), "requests": self.requests, "cut_off": self.cut_off, "repeated": self.repeated}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(Clients(json.loads(Path(sys.argv[1]).read_text())).run())))
