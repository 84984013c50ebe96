#!/usr/bin/env python3
"""Fills FOLDER/TARGET/ with what each fuzz target begins with, from the files of tests/conformance.

Usage: make_seeds.py FOLDER"""
import sys
from pathlib import Path

FILES = Path(__file__).resolve().parent.parent / "conformance" / "v1"
# target: (pattern of conformance files, bytes to put before each, which part of it)
SEEDS = {
    "coded_cell": [("*.ccod", b"", slice(None))],
    "coded_planes": [("*-*mm.ccod", bytes([k, 80, 60, 60]), slice(500, None)) for k in (0, 2)]
    + [("*-packed.ccod", bytes([k, 80, 60, 60]), slice(500, None)) for k in (1, 3)],
    "archive": [("*.cellmap", b"", slice(None))],
    "archive_parts": [("*.cellmap", b"\0", slice(0, 64)), ("*.cellmap", b"\1", slice(1024, 1088)),
                      ("*.cellmap", b"\2", slice(-1000, -72)), ("*.cellmap", b"\3", slice(-2000, None)),
                      ("*.cellmap", b"\4", slice(16384, 16416))],
    "plane_pcd": [("released-folder/*.pcd", b"", slice(None))],
}


def main():
    folder = Path(sys.argv[1])
    for target, seeds in SEEDS.items():
        (folder / target).mkdir(parents=True, exist_ok=True)
        for k, (pattern, before, part) in enumerate(seeds):
            for file in sorted(FILES.glob(pattern)):
                (folder / target / f"{k}-{file.name}").write_bytes(before + file.read_bytes()[part])


if __name__ == "__main__":
    main()
