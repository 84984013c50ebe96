"""A robot that sends CELLs through servers whose database fails: it remembers what was acknowledged, what was refused and how long
each answer took."""
import json
import threading
import time
from collections import Counter
from pathlib import Path

from support import Lost, Refused
from writers import CELL, content_hash


class Uploader(threading.Thread):
    """One drive after the other, each into a map of its own, CELL by CELL and each until it is acknowledged. Sends to the
    servers in turn when one fails."""

    def __init__(self, name, apis, world):
        super().__init__(daemon=True)
        self.prefix, self.apis, self.lattice = name, apis, world.lattice
        self.cells = [(digest, Path(path).read_bytes()) for digest, path in world.upload]
        self.acknowledged, self.at, self.refused, self.lost, self.longest_s = {}, [], Counter(), 0, 0.0
        self.over = threading.Event()

    def run(self):
        count = 0
        while not self.over.is_set():
            count += 1
            name = f"{self.prefix}-{count}"
            made = json.dumps({"name": name, "lattice": self.lattice})
            if self.insist("POST", "/v1/maps", made, "application/json", fine=409) is None:
                return
            self.acknowledged[name] = []
            for digest, data in self.cells:
                if self.insist("PUT", f"/v1/maps/{name}/sessions/up/cells/{digest}", data, CELL) is None:
                    return
                self.acknowledged[name].append(digest)
                self.at.append(time.monotonic())

    def insist(self, *request, fine=None):
        """Until it is acknowledged; None when it is over."""
        while not self.over.is_set():
            begun = time.monotonic()
            try:
                return self.apis[0].call(*request)
            except Lost:
                self.lost += 1
            except Refused as refused:
                if refused.status == fine:
                    return b""
                self.refused[refused.status, refused.code] += 1
            finally:
                self.longest_s = max(self.longest_s, time.monotonic() - begun)
            self.apis = [*self.apis[1:], self.apis[0]]
            self.over.wait(0.05)
        return None

    def stop(self):
        self.over.set()
        self.join()


def count_of(uploaders):
    return sum(len(uploader.at) for uploader in uploaders)


def longest_silence_s(uploaders, since):
    """Longest time without an acknowledgement after a moment."""
    at = [since, *sorted(moment for uploader in uploaders for moment in uploader.at if moment > since)]
    return max((b - a for a, b in zip(at, at[1:])), default=float("inf"))


def lost(api, uploaders):
    """Lines that say which acknowledged CELLs are not there, or not as they were sent. One more may be there: what was carried
    out and its acknowledgement lost."""
    for uploader in uploaders:
        for name, digests in uploader.acknowledged.items():
            found = [cell["hash"] for cell in api.get(f"/v1/maps/{name}/cells?limit=10000")["cells"]]
            if found[:len(digests)] != digests or len(found) > len(digests) + 1:
                yield f"map {name}: {len(digests)} CELLs were acknowledged, there are {len(found)}: {found}"
    name = next((name for name, digests in uploaders[0].acknowledged.items() if digests), None)
    for cell in api.get(f"/v1/maps/{name}/cells")["cells"] if name else ():
        data = api.call("GET", f"/v1/maps/{name}/cells/{cell['id']}", accept=CELL)
        if content_hash(data, cell["hash"]) != cell["hash"]:
            yield f"map {name}: CELL {cell['id']} has other bytes"
