#!/usr/bin/env python3
"""Checks the direction of includes: which room may include which, and the one home of each vendor header.

Debian puts every vendor header on the default include path, so the build cannot notice a wrong include.
Usage: check_includes.py ROOT      prints FILE:LINE: MESSAGE for each violation and exits 1 if there is one
       check_includes.py --self-test
"""
import re
import sys
import tempfile
from pathlib import Path

# room -> rooms it may include beside itself (ARCHITECTURE.md, "Rooms")
ROOMS = {
    "core": [],
    "simd": ["core"],
    "geometry": ["core", "simd"],
    "scan": ["core", "geometry"],
    "cell": ["core", "simd", "geometry", "scan"],
    "registration": ["core", "simd", "geometry", "scan", "cell"],
    "pose_graph": ["core", "geometry", "registration"],
    "place": ["core", "geometry", "scan", "cell", "registration", "simd", "pose_graph"],
    "map": ["core", "geometry", "scan", "cell", "registration", "pose_graph", "place"],
    "change": ["core", "geometry", "cell", "registration", "place"],
    "pipeline": ["core", "geometry", "scan", "cell", "registration", "pose_graph", "place", "map"],
    "codec": ["core", "simd", "geometry", "scan", "cell", "registration", "pose_graph", "place", "map", "pipeline", "schema"],
    "store": ["core", "geometry", "scan", "cell", "pose_graph", "map", "pipeline", "codec"],
    "archive": ["core", "geometry", "scan", "cell", "pose_graph", "map", "pipeline", "codec", "store"],
    "document": ["core", "geometry", "registration", "pose_graph", "place", "map", "change", "store"],
    "evaluation": ["core", "geometry", "scan", "cell", "registration", "place", "pose_graph", "codec"],
    "export": ["core", "geometry", "cell", "place"],
    "simulation": ["core", "geometry", "scan"],
    "pcl": ["core", "geometry", "evaluation"],
    "rosbag": ["core", "geometry", "scan"],
    "auth": ["core"],
    "server": ["auth", "core", "geometry", "scan", "cell", "registration", "pose_graph", "place", "map",
               "change", "pipeline", "codec", "store", "archive", "document"],
    "client": ["auth", "core", "geometry", "scan", "cell", "registration", "pose_graph", "place", "map",
               "change", "pipeline", "codec", "store", "archive", "document", "evaluation", "export", "simulation", "pcl",
               "rosbag"],
}

# vendor header -> rooms that may include it
VENDORS = {
    r"ceres/|omp\.h": ["pose_graph"],
    r"pcl/": ["pcl"],
    r"rosbag/|roslz4/|ros/": ["rosbag"],
    r"(oneapi/)?tbb/": ["core"],
    r"hwy/": ["simd"],
    r"openssl/": ["core"],
    r"zstd\.h|zstd_errors\.h": ["codec"],
    r"xxhash\.h": ["core"],
    r"flatbuffers/": ["codec"],
    r"SQLiteCpp/|sqlite3\.h|libpq-fe\.h|curl/": ["store"],
    r"embree3/": ["simulation"],
    r"GeographicLib/": ["map"],
    r"nanoflann\.hpp": ["evaluation"],
    r"draco/": ["pcl"],
    r"httplib\.h": ["server", "client"],
    r"nlohmann/": ["codec", "document", "server", "client", "evaluation"],
    r"CLI/": ["server", "client"],
    r"spdlog/": ["server", "client"],
    r"prometheus/": ["server"],
}

# Vendor headers that stay out of our own headers altogether.
ONLY_IN_SOURCES = r"ceres/|omp\.h|pcl/|rosbag/|(oneapi/)?tbb/|hwy/|openssl/|zstd|xxhash|flatbuffers/|SQLiteCpp/|sqlite3|libpq-fe|curl/|embree3/|GeographicLib/|nanoflann|draco/|httplib\.h"

INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]')


def room_of(path: Path) -> str:
    """lib/cellmap/<room>/..., server/auth/..., server/..., client/..."""
    if path.parts[:2] == ("server", "auth"):
        return "auth"
    return path.parts[2] if path.parts[0] == "lib" else path.parts[0]


def included_room(header: str, own_room: str):
    """The project room a header belongs to, or None for a vendor or standard header."""
    parts = header.split("/")
    if parts[0] == "cellmap" and len(parts) > 2:
        return parts[1]
    if parts[:2] == ["server", "auth"]:
        return "auth"
    return parts[0] if parts[0] in ("server", "client") else None


def sources(root: Path) -> list:
    return sorted(p for top in ("lib/cellmap", "server", "client") for p in (root / top).rglob("*")
                  if p.suffix in (".hpp", ".cpp"))


def violations(root: Path):
    for file in sources(root):
        path = file.relative_to(root)
        room = room_of(path)
        if room not in ROOMS:
            yield path, 1, f"room '{room}' is not in the table of tests/includes/check_includes.py"
            continue
        for number, line in enumerate(file.read_text().splitlines(), 1):
            match = INCLUDE.match(line)
            if not match:
                continue
            header = match.group(1)
            other = included_room(header, room)
            if other and other != room and other not in ROOMS[room]:
                yield path, number, f"'{room}' may not include '{other}' ({header})"
            for vendor, homes in VENDORS.items():
                if re.match(vendor, header) and room not in homes:
                    yield path, number, f"<{header}> belongs in {' or '.join(homes)}, not in '{room}'"
            if file.suffix == ".hpp" and re.match(ONLY_IN_SOURCES, header) and room not in ("server", "client"):
                yield path, number, f"<{header}> belongs in a .cpp file, not in a header"


def self_test() -> int:
    planted = {
        "lib/cellmap/geometry/a.cpp": ('#include "cellmap/cell/cell.hpp"\n', 1),
        "lib/cellmap/store/b.cpp": ("#include <ceres/ceres.h>\n", 1),
        "lib/cellmap/pose_graph/c.hpp": ("#pragma once\n#include <ceres/ceres.h>\n", 1),
        "client/d.cpp": ('#include "server/api/api.hpp"\n', 1),
        "lib/cellmap/cell/e.cpp": ('#include "cellmap/geometry/pose.hpp"\n#include <vector>\n', 0),
    }
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, (text, _) in planted.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        found = [str(path) for path, _, _ in violations(root)]
    wrong = [name for name, (_, count) in planted.items() if found.count(name) != count]
    print("wrong verdict on: " + ", ".join(wrong) if wrong else "the checker finds what was planted")
    return 1 if wrong else 0


def main() -> int:
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    found = list(violations(Path(sys.argv[1])))
    for path, number, message in found:
        print(f"{path}:{number}: {message}")
    print(f"{len(sources(Path(sys.argv[1])))} files, {len(found)} wrong includes")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
