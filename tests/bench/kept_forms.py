#!/usr/bin/env python3
"""What a map costs in each form in which its CELLs can be kept, from one drive.

For raw, packed and compact CELLs: bytes of CELLs in the store, bytes that a first `cellmap pull` receives, the time
that the build takes, how far planes are from the raw map's, and the error of the trajectory (APE) where the drive
has its truth (poses_gt.txt). Prints a Markdown table.

Usage: kept_forms.py DRIVE [--cellmap PROGRAM] [--cellmapd PROGRAM] [--bound 20mm ...]
       (cellmap simulate --route town --scans 900 --out DRIVE makes one)
"""
import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BUILD = Path(__file__).resolve().parents[2] / "build/release"


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments), "--json"], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}: {done.stderr or done.stdout}")
    return json.loads(done.stdout)


def pulled(options, store, folder):
    """Bytes that a new mirror of the map receives."""
    server = subprocess.Popen([options.cellmapd, "--store", store, "--listen", "127.0.0.1:0"],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        line = server.stdout.readline()
        url = line[line.index("http://"):].split()[0].rstrip("/.")
        return run(options.cellmap, "pull", "town", folder, "--server", url)["received_bytes"]
    finally:
        server.terminate()
        server.wait()


def measure(options, work, encoding, bound):
    name = encoding + (bound or "")
    form = ["--encoding", encoding] + (["--bound", bound] if bound else [])
    store = work / f"{name}.db"
    begin = time.process_time(), time.monotonic()
    info = run(options.cellmap, "build", options.drive, "--store", store, "--map", "town", *form)
    row = {"form": f"{encoding} {bound or ''}".strip(), "seconds": time.monotonic() - begin[1], "cells": info["cells"],
           "planes": info["planes"], "stored": info["stored_bytes"]}
    row["pulled"] = pulled(options, store, work / f"{name}-mirror")
    truth = options.drive / "poses_gt.txt"
    if truth.exists():
        estimate = work / f"{name}.txt"
        run(options.cellmap, "export", "trajectory", "--store", store, "--map", "town", "--format", "kitti",
            "--out", estimate)
        row["ape_m"] = run(options.cellmap, "evaluate", "trajectory", "--estimate", estimate,
                           "--truth", truth)["ape_rmse_m"]
    if bound:
        row["moved"] = run(options.cellmap, "verify", store, "--map", "town", "--source", work / "raw.db")["source"]
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--cellmap", default=BUILD / "client/cellmap")
    parser.add_argument("--cellmapd", default=BUILD / "server/cellmapd")
    parser.add_argument("--bound", nargs="*", default=["10mm", "20mm", "50mm"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        forms = [("raw", None), ("packed", None)] + [("compact", bound) for bound in options.bound]
        rows = [measure(options, Path(folder), *form) for form in forms]
    print(f"{rows[0]['cells']} CELLs, {rows[0]['planes']:,} planes")
    print("| kept as | store, MB | bytes a plane | first pull, MB | APE, m | planes differ from raw: worst / p99 / median, mm |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        moved = row.get("moved")
        moved = " / ".join(f"{1e3 * moved[k]:.2f}" for k in ("worst_m", "p99_m", "median_m")) if moved and "worst_m" in moved else "0"
        ape = f"{row['ape_m']:.4f}" if "ape_m" in row else "-"
        print(f"| {row['form']} | {row['stored'] / 1e6:.2f} | {row['stored'] / row['planes']:.2f} | "
              f"{row['pulled'] / 1e6:.2f} | {ape} | {moved} |")


if __name__ == "__main__":
    main()
