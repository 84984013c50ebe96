"""Three servers over one database behind the shipped configuration of a proxy: one is killed under load and comes back, another
is drained. No request may fail, and all servers must say the same, in the same bytes."""
import re
import subprocess
import time
import urllib.request
from pathlib import Path

from clients import CELL
from database import Cluster
from support import DEPLOY, Server, World, haproxy_command, nginx_command, note, percentile, wait_until

ROLES = {"fetch": 8, "batch": 3, "changes": 3, "look": 3, "uploads": 2}
WORKERS = Path(__file__).parent.parent / "clients.py"


class Proxy:
    """The shipped configuration with a line for each server and without TLS, which tests/e2e/behind_proxy.py tries."""

    def __init__(self, kind, servers, port, folder):
        folder = folder / kind
        folder.mkdir()
        if kind == "haproxy":
            text = (DEPLOY / "haproxy.cfg").read_text()
            text = re.sub(r" ssl crt .*", "", text)
            text = re.sub(r"^ +server cellmapd1 .*\n", "".join(
                f"    server cellmapd{i} 127.0.0.1:{server.port}\n" for i, server in enumerate(servers)), text, flags=re.M)
            self.command = haproxy_command(text, folder, port, "", "", "")
        else:
            text = (DEPLOY / "nginx.conf").read_text()
            text = re.sub(r" +ssl_.*\n", "", text).replace("listen 443 ssl http2;", f"listen 127.0.0.1:{port};")
            text = text.replace("    server 127.0.0.1:8080", "".join(
                f"    server 127.0.0.1:{server.port} max_fails=1 fail_timeout=2s;\n" for server in servers[1:]) +
                f"    server 127.0.0.1:{servers[0].port}")
            self.command = nginx_command(text, folder, port, "", "", "")
        self.log = open(folder / "log", "wb")
        self.process = None

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=self.log, stderr=self.log)

    def stop(self):
        self.process.terminate()
        self.process.wait()


def ask(server, path, accept):
    request = urllib.request.Request(f"http://127.0.0.1:{server.port}{path}", headers={"Accept": accept})
    with urllib.request.urlopen(request) as answer:
        return answer.headers["ETag"], answer.read()


def differences(servers, cells):
    """What servers say differently, byte by byte."""
    asked = [(f"/v1/maps/town/cells/{cell}", CELL) for cell in cells]
    asked += [("/v1/maps/town", "application/json"), ("/v1/maps/town/pose-graph", "application/json"),
              ("/v1/maps/town/changes?since=1", "application/vnd.cellmap.changes")]
    for path, accept in asked:
        answers = {ask(server, path, accept) for server in servers}
        if len(answers) > 1:
            yield f"servers answer {path} with ETags {[tag for tag, _ in answers]} and {[len(data) for _, data in answers]} bytes"


def disturb(servers, seconds):
    """Returns what is wrong with how the second server came back and the third one ended."""
    time.sleep(seconds * 0.25)
    servers[1].kill()
    time.sleep(seconds * 0.25)
    servers[1].start()
    time.sleep(seconds * 0.25)
    servers[2].stop()
    return [] if servers[2].process.returncode == 0 else [f"a drained server ended with {servers[2].process.returncode}"]


def under_load(world, servers, kind, seconds, seed):
    proxy = Proxy(kind, servers, world.proxy_port, world.folder)
    proxy.start()
    try:
        wait_until(lambda: world.through_proxy.get("/v1/maps"), 20, f"{kind} answers")
        wrong = list(differences(servers, world.cells))
        fleet = world.fleet(ROLES, seconds, seed, WORKERS)
        wrong += disturb(servers, seconds)
        told = world.answer_of(fleet)
        servers[2].start()
        wrong += list(differences(servers, world.cells))
    finally:
        proxy.stop()
    failed = sum(told["errors"].values())
    fetches = told["latencies"]["fetch"]
    row = {"requests": told["requests"], "failed": failed, "must_failed": 0, "cut_off_and_asked_again": told["cut_off"],
           "writes_sent_again": told["repeated"], "acknowledged_cells": told["acknowledged"],
           "fetch_p50_ms": round(percentile(fetches, 0.5), 2), "fetch_p99_ms": round(percentile(fetches, 0.99), 1),
           "fetch_longest_ms": round(max(fetches)), "wrong": wrong + told["wrong"]}
    note(f"server-killed, {kind}: {row['requests']} requests, {failed} failed (must 0), {row['cut_off_and_asked_again']} cut off in the "
         f"middle and asked again, {row['writes_sent_again']} writes sent again, {row['acknowledged_cells']} CELLs acknowledged; fetch "
         f"p99 {row['fetch_p99_ms']} ms, longest {row['fetch_longest_ms']} ms")
    return row


def run(options, folder):
    database = Cluster().create()
    servers = [Server(options.cellmapd, database.address, folder / "data", "--role", role, log=folder / f"server{i}.log")
               for i, role in enumerate(("all", "api", "api"))]
    try:
        world = World(options, folder, servers[0])
        for server in servers[1:]:
            server.start()
        seconds = 8 if options.short else 30
        row = {kind: under_load(world, servers, kind, seconds, seed) for seed, kind in
               enumerate(("haproxy",) if options.short else ("haproxy", "nginx"), 1)}
        row["wrong"] = [line for told in row.values() for line in told.pop("wrong")]
        return row
    finally:
        for server in servers:
            server.kill()
        database.remove()
