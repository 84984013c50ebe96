#!/usr/bin/env python3
"""Runs cellmapd as an operator does: the shipped configuration, tokens made and revoked while it runs (SIGHUP), a token
file that is damaged, a rotated audit log, JSON logs, metrics, and the systemd unit's exposure.

Usage: operating.py CELLMAP CELLMAPD DEPLOY_FOLDER UNIT
"""
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

sys.dont_write_bytecode = True
from rules import check, failures  # noqa: E402


class Server:
    def __init__(self, cellmap, cellmapd, shipped, folder):
        self.cellmap, self.folder = cellmap, folder
        text = shipped.replace("/var/lib/cellmap", str(folder)).replace("/var/log/cellmap", str(folder))
        (folder / "cellmapd.conf").write_text(text.replace("127.0.0.1:8080", "127.0.0.1:0"))
        self.admin = self.token("create", "root", "--scope", "admin").strip()
        with open(folder / "log", "w", encoding="utf-8") as log:
            self.process = subprocess.Popen([cellmapd, "--config", folder / "cellmapd.conf"], text=True,
                                            stdout=subprocess.PIPE, stderr=log)
        self.url = re.search(r"http://\S+", self.process.stdout.readline()).group(0)

    def token(self, verb, *arguments):
        return subprocess.run([self.cellmap, "token", verb, *arguments, "--tokens", self.folder / "tokens"], check=True,
                              capture_output=True, text=True).stdout

    def log(self):
        return [json.loads(line) for line in (self.folder / "log").read_text().splitlines()]

    def ask(self, path, token=None, method="GET", body=None):
        headers = {"Content-Type": "application/json"} if body else {}
        if token:
            headers["Authorization"] = "Bearer " + token
        request = urllib.request.Request(self.url + path, body and json.dumps(body).encode(), headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=20) as response:
                return response.status, response.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()

    def hang_up(self, said):
        """SIGHUP, until the log says so."""
        before = len(self.log())
        self.process.send_signal(signal.SIGHUP)
        for _ in range(100):
            if any(said in line["message"] for line in self.log()[before:]):
                return True
            time.sleep(0.05)
        return False


def run(server, folder):
    check(server.ask("/healthz")[0] == 200 and server.ask("/readyz")[0] == 200, "health and readiness need no token")
    check(server.ask("/metrics")[0] == 401, "metrics need a token")
    robot = server.token("create", "robot", "--scope", "map:read").strip()
    check(server.ask("/v1/maps", robot)[0] == 401, "a new token counts from the next SIGHUP on")
    check(server.hang_up("knows 2 tokens") and server.ask("/v1/maps", robot)[0] == 200, "then it does")
    check(server.ask("/v1/maps", robot, "POST", {"name": "a"})[0] == 403, "a reader cannot write")
    check(server.ask("/v1/maps", server.admin, "POST", {"name": "a"})[0] == 201, "an administrator can")

    audit = folder / "audit.jsonl"
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    check([(line["caller"], line["status"]) for line in lines] == [("robot", 403), ("root", 201)], "both are audited", lines)
    audit.rename(folder / "audit.1")

    good = (folder / "tokens").read_text()
    (folder / "tokens").write_text(good + "nonsense\n")
    check(server.hang_up("tokens:3: expected"), "a damaged token file is logged with its line", server.log())
    check(server.ask("/v1/maps", robot)[0] == 200, "and the tokens of before go on")
    (folder / "tokens").write_text(good)
    server.token("revoke", "robot")
    check(server.hang_up("knows 1 tokens") and server.ask("/v1/maps", robot)[0] == 401, "a revoked token is gone")
    server.ask("/v1/maps/a", server.admin, "DELETE")
    check(len(audit.read_text().splitlines()) == 1, "after SIGHUP the audit log begins anew")

    _, metrics = server.ask("/metrics", server.admin)
    for name in ("http_requests_total{", "http_request_duration_seconds_bucket{", "process_cpu_seconds_total ",
                 "process_resident_memory_bytes ", "process_open_fds ", "process_start_time_seconds ",
                 "cellmap_build_info{version=", "cellmap_store_bytes ", 'cellmap_jobs{state="running"}', "cellmap_cells ",
                 'cellmap_token_reloads_total{result="bad"} 1'):
        check(name in metrics, "metrics have " + name)
    check('code="403"' in metrics and 'route="/v1/maps"' in metrics, "requests are counted by route and code")
    value = {line.split()[0]: float(line.split()[1]) for line in metrics.splitlines() if line[:1] not in ("#", "")}
    started = value["process_start_time_seconds"]
    check(abs(time.time() - started) < 120, "the start is now", started)
    resident = value["process_resident_memory_bytes"]
    check(1e6 < resident < 4e9, "memory is plausible", resident)

    server.process.terminate()
    check(server.process.wait(30) == 0, "SIGTERM ends it in order")
    check(all({"time", "level", "message"} <= set(line) for line in server.log()), "every line of the log is JSON")


def refuses(cellmapd, folder, *arguments):
    ended = subprocess.run([cellmapd, "--store", folder / "other.db", *arguments], capture_output=True, text=True,
                           timeout=30, check=False)
    return ended.returncode, ended.stderr


def main():
    cellmap, cellmapd, deploy, unit = sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        server = Server(cellmap, cellmapd, (Path(deploy) / "cellmapd.conf").read_text(), folder)
        try:
            run(server, folder)
        finally:
            server.process.kill()
        code, said = refuses(cellmapd, folder, "--listen", "0.0.0.0:0")
        check(code == 2 and "cellmap token create" in said and "--insecure" in said, "strangers are not served unasked", said)
        os.chmod(folder / "tokens", 0o644)
        code, said = refuses(cellmapd, folder, "--tokens", folder / "tokens")
        check(code == 2 and "chmod 600" in said, "a token file that others may read is refused", said)
    if shutil.which("systemd-analyze"):
        told = subprocess.run(["systemd-analyze", "security", "--offline=true", unit], capture_output=True, text=True,
                              check=False).stdout
        level = re.search(r"exposure level for \S+: ([\d.]+)", told)
        check(level and float(level.group(1)) < 2.5, "systemd finds the unit's exposure below 2.5", told[-300:])
    else:
        print("not checked: systemd-analyze is not installed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
