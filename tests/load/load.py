#!/usr/bin/env python3
"""How cellmapd does under many clients, all of them other processes over loopback.

1. mixture: a fleet that fetches, asks for batches and changes, relocalises, uploads and follows, for a bounded time.
2. crowd: the same with 500 idle and 200 slow connections held beside it.
3. beside nginx: one CELL's bytes, as cellmapd serves them and as nginx serves them from a file, by wrk with 1, 16 and 256
   connections, in turns: of about 30 KB, of which most CELLs of a robot's map are, and a large one.
4. fetches while relocalisation is saturated, against alone, in turns.
5. overload: 150 clients that relocalise at a time. What is too much must be refused with 503 and Retry-After, fetches must go
   on, memory must stay bounded, and afterwards the server must be as before.

Every answer is looked at: bytes of CELLs must be those, acknowledged CELLs must be there. On a machine that does other things
too only ratios of one run mean something; the load before and after is printed.
"""
import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "crash"))
from server import Server  # noqa: E402

CELL = "application/vnd.cellmap.cell"
ROWS = ("mixture", "crowd", "nginx", "relocalising", "overload")
MIXTURE = {"fetch": 8, "batch": 2, "changes": 2, "relocalise": 1, "uploads": 1, "follow": 8}


def note(text):
    print(text, flush=True)


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def memory_mib(pid, what):
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(what + ":"):
            return round(int(line.split()[1]) / 1024, 1)
    return None


def processor_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class World:
    """A server with a map, and files of what is asked of it. `server`: another one than that of a file."""

    def __init__(self, options, folder, server=None):
        self.options, self.folder = options, folder
        (folder / "data").mkdir()
        drive = self.simulate("drive", scans=120, columns=500)
        self.server = server or Server(options.cellmapd, folder / "store.db", folder / "data")
        self.server.start()
        self.api = self.server.api
        self.url = f"http://127.0.0.1:{self.server.port}"
        for name, session in (("town", "drive"), ("up", "up")):
            self.ingest(name, session)
        self.lattice = self.api.get("/v1/maps/town")["lattice"]
        self.cells = self.save("town")
        self.upload = list(self.save("up").values())[:8]
        self.scan = sorted(drive.rglob("*.bin"))[60]

    def simulate(self, name, scans, columns):
        drive = self.folder / "data" / name
        subprocess.run([self.options.cellmap, "simulate", "--route", "town", "--scans", str(scans), "--columns", str(columns),
                        "--out", str(drive), "--json"], check=True, stdout=subprocess.DEVNULL)
        return drive

    def ingest(self, name, session, path="drive"):
        job = self.api.send("POST", f"/v1/maps/{name}/jobs", {"kind": "ingest", "path": path, "session": session, "create_map": True})
        while job["state"] in ("queued", "running"):
            time.sleep(0.1)
            job = self.api.get(f"/v1/jobs/{job['id']}")
        assert job["state"] == "succeeded", job

    def save(self, name):
        saved = {}
        for cell in self.api.get(f"/v1/maps/{name}/cells?limit=10000")["cells"]:
            file = self.folder / f"{name}-{cell['id']}.cell"
            file.write_bytes(self.api.call("GET", f"/v1/maps/{name}/cells/{cell['id']}", accept=CELL))
            saved[cell["id"]] = (cell["hash"], str(file))
        return saved

    def fleet(self, roles, seconds, seed, program=HERE / "fleet.py"):
        task = {"url": self.url, "map": "town", "seconds": seconds, "seed": seed, "roles": roles, "scan": str(self.scan),
                "cells": {cell: path for cell, (_, path) in self.cells.items()}, "upload": self.upload, "lattice": self.lattice}
        file = self.folder / f"task-{seed}.json"
        file.write_text(json.dumps(task))
        return subprocess.Popen([sys.executable, str(program), str(file)], stdout=subprocess.PIPE)


def mixture(world, seconds, title):
    """Two fleets of one mixture, so that no generator is busy all the time."""
    before, begun = processor_s(world.server.process.pid), time.monotonic()
    fleets = [world.fleet(MIXTURE, seconds, seed) for seed in (1000, 2000)]
    answers = [json.loads(fleet.communicate()[0]) for fleet in fleets]
    spent = time.monotonic() - begun
    row = {"seconds": round(spent, 1), "routes": {}, "errors": sum(sum(a["errors"].values()) for a in answers),
           "shed_503": sum(sum(a["shed"].values()) for a in answers), "wrong": [w for a in answers for w in a["wrong"]],
           "acknowledged_uploads": sum(a["acknowledged"] for a in answers), "events": sum(a["events"] for a in answers),
           "server_processor_share": round((processor_s(world.server.process.pid) - before) / spent, 2),
           "generator_processor_share": round(sum(a["processor_s"] for a in answers) / spent, 2),
           "server_memory_mib": memory_mib(world.server.process.pid, "VmRSS")}
    for role in sorted({role for a in answers for role in a["latencies"]}):
        ms = [x for a in answers for x in a["latencies"].get(role, [])]
        row["routes"][role] = {"per_s": round(len(ms) / spent, 1), "p50_ms": round(percentile(ms, 0.5), 1),
                               "p99_ms": round(percentile(ms, 0.99), 1), "p999_ms": round(percentile(ms, 0.999), 1)}
    note(f"\n{title}: {row['seconds']} s, {row['errors']} errors, {row['shed_503']} shed, {len(row['wrong'])} wrong, server "
         f"{row['server_memory_mib']} MiB, processors: server {row['server_processor_share']}, generators {row['generator_processor_share']}")
    for role, figures in row["routes"].items():
        note(f"  {role:11} {figures['per_s']:8.1f}/s   p50 {figures['p50_ms']:8.1f}   p99 {figures['p99_ms']:8.1f}   p99.9 {figures['p999_ms']:8.1f} ms")
    return row


def with_crowd(world, seconds):
    crowd = subprocess.Popen([sys.executable, str(HERE / "crowd.py"), "127.0.0.1", str(world.server.port), "/v1/maps", "500", "200",
                              str(seconds + 6)], stdout=subprocess.PIPE)
    time.sleep(3)
    row = mixture(world, seconds, "with 500 idle and 200 slow connections")
    row["held_to_the_end"] = int(crowd.communicate()[0])
    return row


def wrk(url, connections, seconds, coding="identity"):
    out = subprocess.run(["wrk", "-t", "1", "-c", str(connections), "-d", f"{seconds}s", "-H", f"Accept: {CELL}",
                          "-H", f"Accept-Encoding: {coding}", "-s",
                          str(HERE / "report.lua"), url], check=True, capture_output=True, text=True).stdout
    return json.loads(next(line for line in out.splitlines() if line.startswith("JSON "))[5:])


def start_nginx(folder, file):
    root = folder / "nginx"
    (root / "files").mkdir(parents=True)
    shutil.copy(file, root / "files" / "cell")
    port = Server.__init__.__globals__["free_port"]()
    (root / "nginx.conf").write_text(f"""
daemon off; worker_processes auto; pid {root}/pid; error_log {root}/error.log;
events {{ worker_connections 4096; }}
http {{
  access_log off; sendfile on; tcp_nopush on; tcp_nodelay on; keepalive_timeout 65; keepalive_requests 100000000;
  open_file_cache max=1000; client_body_temp_path {root}/a; proxy_temp_path {root}/b; fastcgi_temp_path {root}/c;
  uwsgi_temp_path {root}/d; scgi_temp_path {root}/e;
  server {{ listen 127.0.0.1:{port} backlog=4096; root {root}/files; }}
}}""")
    os.chmod(folder, 0o755)  # workers of another user read it
    process = subprocess.Popen(["nginx", "-p", str(root), "-c", str(root / "nginx.conf")], stderr=subprocess.DEVNULL)
    url = f"http://127.0.0.1:{port}/cell"
    for _ in range(100):
        try:
            with urllib.request.urlopen(url):
                return process, url
        except OSError:
            time.sleep(0.05)
    raise RuntimeError(f"nginx did not start: {(root / 'error.log').read_text()}")


def median(values):
    return sorted(values)[len(values) // 2]


def stored_bytes(world, name, cell):
    """As the store keeps them and clients ask for them (zstd); what decompressing for others costs is no part of it."""
    url = f"{world.url}/v1/maps/{name}/cells/{cell}"
    with urllib.request.urlopen(urllib.request.Request(url, headers={"Accept": CELL, "Accept-Encoding": "zstd"})) as answer:
        return answer.read()


def beside_nginx(world, seconds):
    """In turns, so that what else the machine does hits both."""
    world.simulate("thin", scans=40, columns=120)  # CELLs of 30 KB
    world.ingest("thin", "thin", "thin")
    thin = {cell["id"]: stored_bytes(world, "thin", cell["id"]) for cell in world.api.get("/v1/maps/thin/cells")["cells"]}
    typical = min(thin, key=lambda cell: abs(len(thin[cell]) - 30_000))
    _, large = min((Path(path).stat().st_size, cell) for cell, (_, path) in world.cells.items())
    return (beside_nginx_with(world, seconds, "thin", typical, (0.9, 0.75, 0.7)) +
            beside_nginx_with(world, seconds, "town", large, (None, None, None)))


def beside_nginx_with(world, seconds, name, cell, least):
    url, data = f"{world.url}/v1/maps/{name}/cells/{cell}", stored_bytes(world, name, cell)
    folder = world.folder / name
    folder.mkdir()
    os.chmod(world.folder, 0o755)
    file, size = folder / "cell.zst", len(data)
    file.write_bytes(data)
    process, nginx_url = start_nginx(folder, file)
    rows = []
    try:
        note(f"\nbeside nginx, a CELL of {size} bytes")
        for connections, must in zip((1, 16, 256), least):
            turns = []
            for _ in range(5):
                before = processor_s(world.server.process.pid)
                turns.append((wrk(nginx_url, connections, seconds, "zstd"), wrk(url, connections, seconds, "zstd")))
                spent_s = processor_s(world.server.process.pid) - before
                turns[-1][1]["processor_us"] = spent_s * 1e6 / max(1, turns[-1][1]["requests_per_s"] * seconds)
            theirs, ours = (median([turn[i]["requests_per_s"] for turn in turns]) for i in (0, 1))
            ratio = median([b["requests_per_s"] / a["requests_per_s"] for a, b in turns])
            processor_us = median([b["processor_us"] for _, b in turns])
            rows.append({"bytes": size, "connections": connections, "nginx_per_s": theirs, "cellmapd_per_s": ours, "ratio": round(ratio, 3),
                         "must": must, "processor_us": round(processor_us, 1), "errors": sum(turn[1]["errors"] for turn in turns)})
            note(f"  {connections:3} connections: nginx {theirs:9.0f}/s, cellmapd {ours:9.0f}/s, ratio {ratio:.2f}"
                 f"{f' (must {must})' if must else ''}, {processor_us:.1f} us of processor a request")
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()
    return rows


def while_relocalising(world, seconds):
    """p99 of fetches over 4 connections, alone and while 6 clients relocalise one after the other."""
    cell = sorted(world.cells)[0]
    url = f"{world.url}/v1/maps/town/cells/{cell}"
    alone, busy = [], []
    for turn in range(3):
        alone.append(wrk(url, 4, seconds))
        fleet = world.fleet({"relocalise": 6}, seconds + 2, 3000 + turn)
        time.sleep(1)
        busy.append(wrk(url, 4, seconds))
        answer = json.loads(fleet.communicate()[0])
    ratio = median([b["p99_ms"] / a["p99_ms"] for a, b in zip(alone, busy)])
    row = {"alone_p99_ms": median([a["p99_ms"] for a in alone]), "busy_p99_ms": median([b["p99_ms"] for b in busy]),
           "alone_per_s": median([a["requests_per_s"] for a in alone]), "busy_per_s": median([b["requests_per_s"] for b in busy]),
           "relocalisations": len(answer["latencies"].get("relocalise", [])), "ratio": round(ratio, 2), "must": 3}
    note(f"\nfetches while relocalisation is saturated: p99 {row['busy_p99_ms']:.2f} ms against {row['alone_p99_ms']:.2f} alone, "
         f"ratio {ratio:.1f} (must be below 3); {row['busy_per_s']:.0f}/s against {row['alone_per_s']:.0f}/s")
    return row


def overload(world, seconds):
    """More than can be answered, from clients that come again at once."""
    pid = world.server.process.pid
    before = memory_mib(pid, "VmRSS")
    fleets = [world.fleet({"relocalise": 75, "fetch": 2, "changes": 1}, seconds, seed) for seed in (4000, 5000)]
    highest = before
    with ThreadPoolExecutor() as pool:  # a pipe that nobody reads holds its writer up
        outputs = [pool.submit(fleet.communicate) for fleet in fleets]
        while not all(output.done() for output in outputs):
            highest = max(highest, memory_mib(pid, "VmRSS"))
            time.sleep(0.1)
    answers = [json.loads(output.result()[0]) for output in outputs]
    fetches = [x for a in answers for x in a["latencies"].get("fetch", [])]
    relocalisations = [x for a in answers for x in a["latencies"].get("relocalise", [])]
    shed = sum(a["shed"].get("relocalise", 0) for a in answers)
    row = {"relocalised": len(relocalisations), "shed_503": shed, "fetches": len(fetches),
           "fetch_p99_ms": round(percentile(fetches, 0.99), 1) if fetches else None,
           "slowest_relocalisation_ms": round(max(relocalisations, default=0)),
           "memory_mib": {"before": before, "highest": highest}, "wrong": [w for a in answers for w in a["wrong"]]}
    shed_others = sum(sum(a["shed"].values()) for a in answers) - shed
    checks = {"nothing was shed": shed > 0, "no relocalisation was answered": len(relocalisations) > 0,
              f"{shed_others} other requests were shed": shed_others == 0,
              "fetches took over a second": bool(fetches) and row["fetch_p99_ms"] < 1000,
              "who was not shed waited over 11 s": row["slowest_relocalisation_ms"] < 11_000,
              "the bodies of 150 clients took over 512 MiB": highest - before < 512}
    row["wrong"] += [f"overload: {what}" for what, holds in checks.items() if not holds]
    note(f"\noverload by 150 clients that relocalise: {len(relocalisations)} answered in up to {row['slowest_relocalisation_ms']} ms, {shed} refused "
         f"(503, Retry-After), {len(fetches)} fetches with p99 {row['fetch_p99_ms']} ms, memory {before} to {highest} MiB")
    row["wrong"] += mixture(world, 1, "after it")["wrong"]
    return row


def measure(options, folder):
    result = {"load_before": os.getloadavg(), "processors": os.cpu_count()}
    note(f"load before: {result['load_before'][0]:.1f} on {result['processors']} processors")
    world = World(options, folder)
    try:
        mixture(world, 2, "warming up")
        if "mixture" in options.rows:
            result["mixture"] = mixture(world, options.seconds, "mixture")
        if {"mixture", "crowd"} <= options.rows:
            result["crowd"] = with_crowd(world, options.seconds)
            ratio = result["crowd"]["routes"]["fetch"]["p99_ms"] / result["mixture"]["routes"]["fetch"]["p99_ms"]
            result["crowd"]["fetch_p99_ratio"] = round(ratio, 2)
            note(f"  fetch p99 against without the crowd: {ratio:.2f} (must be below 2)")
        short = max(1, options.seconds // 5)
        for name, tool, row in (("nginx", "nginx", beside_nginx), ("relocalising", "wrk", while_relocalising)):
            if name in options.rows and shutil.which(tool) and shutil.which("wrk"):
                result[name] = row(world, short)
            elif name in options.rows:
                note(f"\nNOT MEASURED: {name}; it takes wrk and nginx (Debian packages wrk, nginx-light)")
        if "overload" in options.rows:
            result["overload"] = overload(world, options.seconds)
        result["server_peak_mib"] = memory_mib(world.server.process.pid, "VmHWM")
        note(f"\nserver's memory at its highest: {result['server_peak_mib']} MiB")
    finally:
        world.server.kill()
    result["load_after"] = os.getloadavg()
    note(f"load after: {result['load_after'][0]:.1f}")
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=15, help="of the mixture; the rows of wrk take a fifth each, three times")
    parser.add_argument("--rows", type=lambda text: set(text.split(",")), default=set(ROWS), help=f"some of {','.join(ROWS)}; default: all")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--cellmap", default="build/release/client/cellmap")
    parser.add_argument("--cellmapd", default="build/release/server/cellmapd")
    options = parser.parse_args()
    if not options.rows <= set(ROWS):
        parser.error(f"--rows takes {','.join(ROWS)}")
    with tempfile.TemporaryDirectory() as folder:
        result = measure(options, Path(folder))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    wrong = [line for row in result.values() if isinstance(row, dict) for line in row.get("wrong", [])]
    for line in wrong:
        print("WRONG:", line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
