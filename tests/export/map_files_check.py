#!/usr/bin/env python3
"""Reads what other programs read of a map: Autoware's tile metadata, nav2's map YAML and PGM (with python3-yaml)
and a PLY mesh, with nothing of ours. Prints a JSON summary. Exits 1 and says why where a rule is broken.
Usage: map_files_check.py tiles FOLDER | occupancy FILE.yaml | discs FILE.ply
"""
import json
import struct
import sys
from pathlib import Path

import yaml


def fail(message):
    print(message)
    sys.exit(1)


def pcd_points(file):
    head, _, body = file.read_bytes().partition(b"DATA binary\n")
    fields = dict(line.split(" ", 1) for line in head.decode().splitlines() if line and line[0] != "#")
    count = int(fields["POINTS"])
    if fields["FIELDS"] != "x y z normal_x normal_y normal_z" or int(fields["WIDTH"]) != count:
        fail(f"{file}: {fields}")
    if len(body) != 24 * count:
        fail(f"{file}: {len(body)} bytes for {count} points")
    return [struct.unpack_from("<6f", body, 24 * i) for i in range(count)]


def tiles(folder):
    metadata = yaml.safe_load((folder / "pointcloud_map_metadata.yaml").read_text())
    size = metadata.pop("x_resolution"), metadata.pop("y_resolution")
    if {p.name for p in folder.glob("*.pcd")} != set(metadata):
        fail("files and metadata name different tiles")
    total = 0
    for name, corner in metadata.items():
        points = pcd_points(folder / name)
        total += len(points)
        for p in points:
            if not all(corner[a] <= p[a] <= corner[a] + size[a] for a in (0, 1)):
                fail(f"{name}: a point at {p[:2]} outside the tile at {corner}")
    return {"x_resolution": size[0], "y_resolution": size[1], "tiles": len(metadata), "points": total}


def occupancy(file):
    text = yaml.safe_load(file.read_text())
    image = (file.parent / text["image"]).read_bytes()
    magic, size, most, pixels = image.split(b"\n", 3)
    width, height = map(int, size.split())
    if magic != b"P5" or most != b"255" or len(pixels) != width * height:
        fail(f"image: {magic} {size} {most}, {len(pixels)} pixels")
    # What nav2's map_server makes of it, mode trinary.
    cells = {"occupied": 0, "free": 0, "unknown": 0}
    occupied = []
    for i, shade in enumerate(pixels):
        p = (shade if text["negate"] else 255 - shade) / 255
        kind = ("occupied" if p > text["occupied_thresh"] else
                "free" if p < text["free_thresh"] else "unknown")
        cells[kind] += 1
        if kind == "occupied":
            row, column = divmod(i, width)
            occupied.append([text["origin"][0] + (column + 0.5) * text["resolution"],
                             text["origin"][1] + (height - row - 0.5) * text["resolution"]])
    return {"width": width, "height": height, "occupied_at": occupied, **cells}


def discs(file):
    head, _, body = file.read_bytes().partition(b"end_header\n")
    lines = head.decode().splitlines()
    if lines[:2] != ["ply", "format binary_little_endian 1.0"]:
        fail(f"{lines[:2]}")
    counts = {w[1]: int(w[2]) for w in (line.split() for line in lines) if w[0] == "element"}
    properties = [line.split()[1:] for line in lines if line.startswith("property")]
    expected = [["float", n] for n in ("x", "y", "z", "nx", "ny", "nz")] + [
        ["list", "uchar", "int", "vertex_indices"]]
    if properties != expected:
        fail(f"{properties}")
    vertices = [struct.unpack_from("<6f", body, 24 * i) for i in range(counts["vertex"])]
    faces, at = [], 24 * len(vertices)
    for _ in range(counts["face"]):
        corners = body[at]
        faces.append(struct.unpack_from(f"<{corners}i", body, at + 1))
        at += 1 + 4 * corners
    if at != len(body) or any(not 0 <= v < len(vertices) for face in faces for v in face):
        fail(f"{len(body)} bytes, {at} expected, or a vertex that is not there")
    return {"faces": [[vertices[v] for v in face] for face in faces]}


def main():
    kind, path = sys.argv[1], Path(sys.argv[2])
    print(json.dumps({"tiles": tiles, "occupancy": occupancy, "discs": discs}[kind](path)))


if __name__ == "__main__":
    main()
