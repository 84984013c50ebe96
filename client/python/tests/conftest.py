"""The conformance vectors, a slow twin or two, and a real cellmapd with a small simulated map."""

import json
import os
import re
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
VECTORS = ROOT / "tests" / "conformance" / "v1"
SCANS = 70


def twin(name: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((VECTORS / f"{name}.json").read_text())
    return document


@dataclass
class Server:
    url: str
    folder: Path  #: has drive/, a KITTI folder of SCANS scans with ground truth


def run(*arguments: object) -> None:
    subprocess.run([str(a) for a in arguments], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    """A server with the map "town" of session "monday"; tests that change it use maps of their own."""
    cellmap, cellmapd = os.environ.get("CELLMAP_PROGRAM"), os.environ.get("CELLMAPD_PROGRAM")
    if not cellmap or not cellmapd:
        pytest.skip("CELLMAP_PROGRAM and CELLMAPD_PROGRAM do not name the built programs")
    with tempfile.TemporaryDirectory(prefix="cellmap-python-") as name:
        folder = Path(name)
        run(cellmap, "simulate", "--route", "town", "--scans", SCANS, "--columns", 600, "--out", folder / "drive")
        run(cellmap, "build", folder / "drive", "--store", folder / "map.db", "--map", "town", "--session", "monday",
            "--lattice-size", 20_000)
        daemon = subprocess.Popen(
            [cellmapd, "--store", folder / "map.db", "--listen", "127.0.0.1:0", "--data-root", folder, "--threads", "1",
             "--log-level", "error"], stdout=subprocess.PIPE, text=True)
        assert daemon.stdout is not None
        address = re.search(r"http://\S+", daemon.stdout.readline())
        assert address, "cellmapd did not say where it listens"
        yield Server(address[0], folder)
        daemon.terminate()
        daemon.wait(30)
