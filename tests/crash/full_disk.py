#!/usr/bin/env python3
"""A cellmapd whose files cannot grow beyond some megabytes, as on a full disk: what finds no room is refused with 507, or ends
its job with an error that says so; the server goes on, and with room everything goes on where it was.
Usage: full_disk.py --cellmap FILE --cellmapd FILE
"""
import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from crash import LATTICE, simulate, wait_for
from server import Refused, Server
from store_check import check_store
from writers import ARCHIVE, content, require, require_same

LIMIT = 2 << 20


class SmallDisk(Server):
    """Its files are bounded; too much is an error of the write, and no signal."""

    def spawn(self):
        def bound():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, resource.RLIM_INFINITY))
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=self.log, preexec_fn=bound, restore_signals=False)


def require_refusal(status, act):
    try:
        act()
    except Refused as refused:
        return require(refused.status == status, f"expected {status}, found {refused}")
    return require(False, f"expected {status}, nothing was refused")


def run(options, folder):
    simulate(options.cellmap, folder, "drive", 52, 1)
    ingest = {"kind": "ingest", "path": "drive", "session": "first", "create_map": True, "lattice": LATTICE}
    whole = Server(options.cellmapd, folder / "whole.db", folder / "data")
    small = SmallDisk(options.cellmapd, folder / "small.db", folder / "data")
    try:
        whole.start()
        wait_for(whole.api, whole.api.send("POST", "/v1/maps/town/jobs", ingest))
        expected = content(whole.api, "town")
        small.start()
        api = small.api
        require_refusal(507, lambda: api.call("PUT", "/v1/maps/big/archive", os.urandom(4 * LIMIT), ARCHIVE))
        require([m["name"] for m in api.get("/v1/maps")["maps"]] == [], "something of a refused archive is there")
        job = api.send("POST", "/v1/maps/town/jobs", ingest)
        while job["state"] in ("queued", "running"):
            time.sleep(0.05)
            job = api.get(f"/v1/jobs/{job['id']}")
        require(job["state"] == "failed" and job["error"]["code"] in ("disk-full", "io") and "free space" in job["error"]["message"],
                f"the job did not say that the disk is full: {job}")
        cells = api.get("/v1/maps/town")["cells"]
        require(0 < cells < len(expected["cells"]), f"{cells} CELLs found room, of {len(expected['cells'])}")
        api.call("GET", "/healthz")
        small.stop()
        wrong = check_store(small.store, folder, at_rest=True)
        require(not wrong, f"the store is damaged: {wrong}")
        roomy = Server(options.cellmapd, small.store, folder / "data")
        try:
            roomy.start()
            wait_for(roomy.api, roomy.api.send("POST", "/v1/maps/town/jobs", ingest))
            require_same(content(roomy.api, "town"), expected, "the map with room again")
        finally:
            roomy.kill()
    finally:
        whole.kill()
        small.kill()
    print(f"a full disk after {cells} of {len(expected['cells'])} CELLs: said so, lost nothing, went on")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "data").mkdir()
        run(options, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
