"""A mixed fleet on one event loop: clients that fetch, ask, relocalise, upload and follow, each over a connection of its own.

Usage: fleet.py FILE, which is JSON: {url, map, seconds, seed, roles: {role: count}, cells: {id: path of its bytes},
scan: path, upload: [[hash, path]...], lattice}. Prints JSON: latencies in milliseconds by role, errors, wrong answers.
"""
import asyncio
import json
import random
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

CELL = "application/vnd.cellmap.cell"


class Connection:
    """HTTP/1.1 on one kept connection, which is opened again where the server closes it."""

    def __init__(self, host, port):
        self.host, self.port, self.reader, self.writer = host, port, None, None
        self.retry_after = None  # of the last answer

    async def ask(self, method, path, body=b"", media_type=None, accept="*/*"):
        """Status and body."""
        if self.writer is None:
            self.reader, self.writer = await asyncio.open_connection(self.host, self.port, limit=1 << 20)
        head = f"{method} {path} HTTP/1.1\r\nHost: {self.host}\r\nAccept: {accept}\r\n"
        if media_type:
            head += f"Content-Type: {media_type}\r\n"
        if body or method in ("POST", "PUT"):
            head += f"Content-Length: {len(body)}\r\n"
        try:
            self.writer.write(head.encode() + b"\r\n" + body)
            await self.writer.drain()
            status, length, close = await self.read_head()
            data = await self.reader.readexactly(length)
        except (OSError, asyncio.IncompleteReadError):
            self.close()
            raise
        if close:
            self.close()
        return status, data

    async def read_head(self):
        lines = (await self.reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
        fields = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:] if line)}
        self.retry_after = fields.get("retry-after")
        return int(lines[0].split()[1]), int(fields.get("content-length", 0)), fields.get("connection", "").lower() == "close"

    def close(self):
        if self.writer:
            self.writer.close()
        self.writer = None


class Fleet:
    def __init__(self, task):
        self.task = task
        where = urlsplit(task["url"])
        self.host, self.port = where.hostname, where.port
        self.map = f"/v1/maps/{task['map']}"
        self.cells = {int(cell): Path(path).read_bytes() for cell, path in task["cells"].items()}
        self.scan = Path(task["scan"]).read_bytes()
        self.upload = [(digest, Path(path).read_bytes()) for digest, path in task["upload"]]
        self.latencies, self.errors, self.shed, self.wrong = {}, {}, {}, []
        self.acknowledged = self.events = 0
        self.end = time.monotonic() + task["seconds"]

    async def timed(self, role, connection, *request, **how):
        begun = time.monotonic()
        status, data = await connection.ask(*request, **how)
        if status == 503:  # shed: not served, and not an error
            self.shed[role] = self.shed.get(role, 0) + 1
            if not connection.retry_after:
                self.wrong.append(f"{role}: 503 without Retry-After")
            await asyncio.sleep(0.2)
            return None
        if status >= 400:
            self.errors[role] = self.errors.get(role, 0) + 1
            self.wrong.append(f"{role}: {status} {data[:200]!r}")
            return None
        self.latencies.setdefault(role, []).append((time.monotonic() - begun) * 1e3)
        return data

    async def client(self, role, seed):
        rng, connection = random.Random(seed), Connection(self.host, self.port)
        while time.monotonic() < self.end:
            try:
                await getattr(self, role)(connection, rng)
            except (OSError, asyncio.IncompleteReadError) as error:
                self.errors[role] = self.errors.get(role, 0) + 1
                self.wrong.append(f"{role}: connection lost: {error!r}")
                await asyncio.sleep(0.1)
        connection.close()

    async def fetch(self, connection, rng):
        cell = rng.choice(list(self.cells))
        data = await self.timed("fetch", connection, "GET", f"{self.map}/cells/{cell}", accept=CELL)
        if data is not None and data != self.cells[cell]:
            self.wrong.append(f"CELL {cell} came with other bytes")

    async def batch(self, connection, rng):
        ids = sorted(rng.sample(list(self.cells), min(4, len(self.cells))))
        data = await self.timed("batch", connection, "POST", f"{self.map}/cells:batch", json.dumps({"ids": ids}).encode(),
                                "application/json", accept="application/vnd.cellmap.cells")
        if data is not None and data != b"".join(
                cell.to_bytes(4, "little") + len(self.cells[cell]).to_bytes(4, "little") + self.cells[cell] for cell in ids):
            self.wrong.append("a batch came with other bytes")
        await asyncio.sleep(0.05)

    async def changes(self, connection, rng):
        data = await self.timed("changes", connection, "GET", f"{self.map}/changes?since=0", accept="application/json")
        if data is not None and len(json.loads(data)["added"]) != len(self.cells):
            self.wrong.append("changes lack CELLs")
        await asyncio.sleep(0.1)

    async def relocalise(self, connection, rng):
        data = await self.timed("relocalise", connection, "POST", f"{self.map}/relocalise", self.scan,
                                "application/octet-stream", accept="application/json")
        if data is not None and not json.loads(data)["found"]:
            self.wrong.append("a scan of the map was not found")

    async def uploads(self, connection, rng):
        """A drive CELL by CELL into a map of its own, which is looked at and deleted."""
        name = f"fleet-{self.task['seed']}-{rng.randrange(10**9)}"
        made = await self.timed("create", connection, "POST", "/v1/maps",
                                json.dumps({"name": name, "lattice": self.task["lattice"]}).encode(), "application/json")
        if made is None:
            return
        sent = 0
        for digest, data in self.upload:
            if await self.timed("upload", connection, "PUT", f"/v1/maps/{name}/sessions/up/cells/{digest}", data, CELL) is None:
                break
            sent += 1
            self.acknowledged += 1
            await asyncio.sleep(0.05)
        status, listed = await connection.ask("GET", f"/v1/maps/{name}/cells?limit=10000", accept="application/json")
        if status == 200 and len(json.loads(listed)["cells"]) < sent:
            self.wrong.append(f"{sent} CELLs were acknowledged, {len(json.loads(listed)['cells'])} are there")
        await self.timed("delete", connection, "DELETE", f"/v1/maps/{name}")

    async def follow(self, connection, rng):
        """Server-sent events: counts pieces until the end."""
        reader, writer = await asyncio.open_connection(self.host, self.port)
        writer.write(f"GET {self.map}/events HTTP/1.1\r\nHost: {self.host}\r\nAccept: text/event-stream\r\n\r\n".encode())
        try:
            while time.monotonic() < self.end:
                try:
                    data = await asyncio.wait_for(reader.read(4096), self.end - time.monotonic() + 0.01)
                except asyncio.TimeoutError:
                    break
                if not data:
                    break
                self.events += 1
        finally:
            writer.close()

    async def run(self):
        clients, seed = [], self.task["seed"]
        for role, count in self.task["roles"].items():
            for _ in range(count):
                seed += 1
                clients.append(self.client(role, seed))
        await asyncio.gather(*clients)
        return {"latencies": self.latencies, "errors": self.errors, "shed": self.shed, "wrong": self.wrong[:20],
                "acknowledged": self.acknowledged, "events": self.events, "processor_s": time.process_time()}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(Fleet(json.loads(Path(sys.argv[1]).read_text())).run())))
