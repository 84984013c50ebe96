#!/usr/bin/env python3
"""Writes the conformance files of format version 1 without any code of the library.

Each file exists twice. NAME.cell comes from its JSON twin through `flatc --binary`: a layout that the library
would not choose. NAME.canonical.cell has the layout of schema/FORMAT.md, "How the library lays out a CELL",
made by the small FlatBuffers builder below. Files that are in the repository are read for ever: this script may
add files, and must reproduce the old ones to the byte.

Usage: generate.py            needs flatc; writes into v1/ beside this file
       generate.py --check    writes nothing, exits 1 where a file would change
"""
import hashlib
import json
import math
import struct
import subprocess
import sys
import tempfile
from decimal import Decimal, getcontext
from pathlib import Path

import coded_cell

HERE = Path(__file__).resolve().parent
SCHEMA = HERE.parent.parent / "schema"
VERSION = 1


# --- The Fibonacci lattice, from FORMAT.md, "Lattices" -------------------------------------------------

def sphere_direction(i, m, a):
    """The exact evaluation: Python's floats are binary64 and round after each operation."""
    f = i * 0x9E3779B97F4A7C15 % 2**64
    b = 2 * m - a
    z = (m - a) / m
    r = math.sqrt(float(a * b)) / m
    q = ((f + 2**61) % 2**64) >> 62
    rest = (f - q * 2**62) % 2**64
    x = float(rest - 2**64 if rest >= 2**63 else rest) * (2 * math.pi * 2.0**-64)
    x2 = x * x
    s = c = 1.0
    for n in range(16, 0, -2):
        s = 1.0 - (x2 / (n * (n + 1))) * s
        c = 1.0 - (x2 / (n * (n - 1))) * c
    s *= x
    cos, sin = [(c, s), (-s, c), (-c, -s), (s, -c)][q]
    return r * cos, r * sin, z


def lattice_direction(i, size):
    return sphere_direction(i, size, 2 * i + 1)


def bands(size):
    """All directions of the kind "Fibonacci bands", each with the number of points on its sphere and its index there."""
    for points, low, high in [(size, -0.2, 0.7), (2 * size, -0.6, -0.2), (size // 200, -2.0, -0.6)]:
        for i in range(points):
            x, z, y = sphere_direction(i, points - 1, 2 * i)
            if low <= z < high:
                yield (x, y, z), points, i


def check_band(direction, points, i):
    """From the definition, the golden ratio in 60 digits."""
    getcontext().prec = 60
    azimuth = 2 * math.pi * float(Decimal(i) / ((1 + Decimal(5).sqrt()) / 2) % 1)
    y = 1 - Decimal(2 * i) / (points - 1)
    r = float((1 - y * y).sqrt())
    expected = (r * math.cos(azimuth), float(y), r * math.sin(azimuth))
    assert max(abs(u - v) for u, v in zip(direction, expected)) < 1e-12, (i, points, direction, expected)


def check_lattice(i, size, direction):
    """The same from the definition with the golden ratio, in 60 digits up to the last sine."""
    getcontext().prec = 60
    turn = Decimal(i) / ((1 + Decimal(5).sqrt()) / 2) % 1
    azimuth = 2 * math.pi * float(turn)
    z = float(Decimal(size - 2 * i - 1) / size)
    r = float((1 - (Decimal(size - 2 * i - 1) / size) ** 2).sqrt())
    expected = (r * math.cos(azimuth), r * math.sin(azimuth), z)
    assert max(abs(u - v) for u, v in zip(direction, expected)) < 1e-12, (i, size, direction, expected)


# --- A FlatBuffers builder, back to front --------------------------------------------------------------

SIZES = {"B": 1, "H": 2, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8}


class Builder:
    """Offsets are counted from the end of the buffer, which grows towards its beginning."""

    def __init__(self):
        self.data, self.min_align, self.vtables = b"", 1, []

    def align(self, alignment, upcoming):
        if upcoming == 0:  # an empty vector asks for no alignment of its elements
            return
        self.min_align = max(self.min_align, alignment)
        self.data = bytes(-(len(self.data) + upcoming) % alignment) + self.data

    def push(self, packed, alignment):
        self.align(alignment, len(packed))
        self.data = packed + self.data
        return len(self.data)

    def number(self, kind, value):
        return self.push(struct.pack("<" + kind, value), SIZES[kind])

    def reference(self, target):
        self.align(4, 4)
        return self.number("I", len(self.data) + 4 - target)

    def vector(self, packed, count, alignment):
        self.align(4, len(packed))
        self.align(alignment, len(packed))
        self.data = packed + self.data
        return self.number("I", count)

    def string(self, text):
        packed = text.encode() + b"\0"
        self.align(4, len(packed))
        self.data = packed + self.data
        return self.number("I", len(packed) - 1)

    def offsets(self, targets):
        self.align(4, 4 * len(targets))
        for target in reversed(targets):
            self.reference(target)
        return self.number("I", len(targets))

    def table(self, fields):
        """fields: id -> ("ref", offset) | ("struct", packed bytes) | (number kind, value)"""
        def order(item):
            ident, (kind, _) = item
            return (-SIZES.get(kind, 4), -ident)

        start, places = len(self.data), {}
        for ident, (kind, value) in sorted(fields.items(), key=order):
            if kind == "ref":
                places[ident] = self.reference(value)
            elif kind == "struct":
                places[ident] = self.push(value, 8)
            elif kind == "d" or value != 0:  # the one double has another default, which its caller leaves out
                places[ident] = self.number(kind, value)
        table = self.number("I", 0)
        count = max(places, default=-1) + 1
        entries = [table - places[i] if i in places else 0 for i in range(count)]
        vtable = struct.pack(f"<{2 + count}H", 4 + 2 * count, table - start, *entries)
        known = [at for packed, at in self.vtables if packed == vtable]
        if known:
            at = known[0]
        else:
            self.data = vtable + self.data
            at = len(self.data)
            self.vtables.append((vtable, at))
        position = len(self.data) - table
        distance = struct.pack("<i", at - table)
        self.data = self.data[:position] + distance + self.data[position + 4:]
        return table

    def finish(self, root, identifier):
        self.align(self.min_align, 8)
        self.data = identifier + self.data
        self.reference(root)
        return self.data


# --- The five kinds of file in the library's layout -----------------------------------------------------

POSE = ["r00", "r01", "r02", "tx", "r10", "r11", "r12", "ty", "r20", "r21", "r22", "tz"]
INFORMATION = [f"m{i}{j}" for i in range(6) for j in range(i, 6)]
SCORES = ["inlier_ratio_all", "inlier_ratio_hit", "share_in_front", "share_beyond", "median_residual_m"]


def doubles(values, names):
    return struct.pack(f"<{len(names)}d", *[values[name] for name in names])


def floats(values):
    return struct.pack(f"<{len(values)}f", *[float(v) for v in values])


def canonical_cell(t):
    b, n = Builder(), len(t["indices"])
    packed = b"".join(floats([p["distance"], p["nx"], p["ny"], p["nz"]]) for p in t["planes"])
    planes = b.vector(packed, n, 16)
    indices = b.vector(struct.pack(f"<{n}I", *t["indices"]), n, 4)
    session = b.string(t["session"])
    kind = ["", "Fibonacci", "FibonacciBands"].index(t["lattice"]["kind"])
    lattice = b.table({0: ("B", kind), 1: ("B", 1), 2: ("I", t["lattice"]["size"])})
    s = t.get("statistics", {})
    names = ["points", "points_in_planes", "patches_hit", "rejected_few_points", "rejected_gap",
             "rejected_planarity", "rejected_grazing"]
    statistics = b.table({i: ("Q" if i < 2 else "I", s.get(name, 0)) for i, name in enumerate(names)})
    root = b.table({
        0: ("H", VERSION), 1: ("struct", bytes(32)), 2: ("ref", lattice), 3: ("ref", indices), 4: ("ref", planes),
        5: ("ref", session), 6: ("I", t.get("sequence", 0)), 7: ("struct", doubles(t["t_odom_cell"], POSE)),
        8: ("q", t.get("first_stamp_ns", 0)), 9: ("q", t.get("last_stamp_ns", 0)),
        10: ("I", t.get("first_scan", 0)), 11: ("I", t.get("scan_count", 0)), 12: ("ref", statistics)})
    return seal(b.finish(root, b"CELL"))


def canonical_coded_cell(t):
    b = Builder()
    data = b.vector(bytes(t["data"]), len(t["data"]), 1)
    session = b.string(t["session"])
    kind = ["", "Fibonacci", "FibonacciBands"].index(t["lattice"]["kind"])
    lattice = b.table({0: ("B", kind), 1: ("B", 1), 2: ("I", t["lattice"]["size"])})
    statistics = b.table({})
    raw = struct.pack("<4Q", *[t["raw_hash"][f"word{i}"] for i in range(4)])
    root = b.table({
        0: ("H", VERSION), 1: ("struct", bytes(32)), 2: ("struct", bytes(32)), 3: ("struct", raw),
        4: ("B", ["", "Packed", "Compact", "Compact2"].index(t["encoding"])), 5: ("I", t["bound_um"]), 6: ("ref", lattice),
        7: ("I", t["plane_count"]), 8: ("I", t["coarse_plane_count"]), 9: ("I", t["coarse_bytes"]),
        10: ("ref", session), 11: ("I", t.get("sequence", 0)), 12: ("struct", doubles(t["t_odom_cell"], POSE)),
        13: ("q", t.get("first_stamp_ns", 0)), 14: ("q", t.get("last_stamp_ns", 0)),
        15: ("I", t.get("first_scan", 0)), 16: ("I", t.get("scan_count", 0)), 17: ("ref", statistics),
        18: ("ref", data)})
    return seal_coded(b.finish(root, b"CCOD"), t)


def canonical_pose_graph(t):
    b = Builder()
    packed = b"".join(struct.pack("<I4x", n["cell"]) + doubles(n["t_map_cell"], POSE) for n in t["nodes"])
    nodes = b.vector(packed, len(t["nodes"]), 8)
    all_constraints = b.offsets([canonical_constraint(b, c) for c in t["constraints"]])
    root = b.table({0: ("H", VERSION), 1: ("Q", t["revision"]), 2: ("ref", nodes), 3: ("ref", all_constraints)})
    return b.finish(root, b"CPGR")


def canonical_constraint(b, c):
    kinds, origins = ["", "Odometry", "Bidirectional", "Loop"], ["", "Mapper", "Detection", "User"]
    s = c.get("scores") or dict.fromkeys(["points", "hits"] + SCORES, 0)
    judgement = {8: ("d", c["weight"])} if c.get("weight", 1) != 1 else {}
    return b.table({
        **judgement, 9: ("B", c.get("pinned", False)), 0: ("I", c["id"]), 1: ("I", c["from"]), 2: ("I", c["to"]), 3: ("B", kinds.index(c["kind"])),
        4: ("B", origins.index(c["origin"])), 5: ("struct", doubles(c["t_from_to"], POSE)),
        6: ("struct", doubles(c["information"], INFORMATION)),
        7: ("struct", struct.pack("<2I", s["points"], s["hits"]) + doubles(s, SCORES))})


def canonical_changes(t):
    b, sessions, cells = Builder(), {}, []
    for c in t["added"]:
        if c["session"] not in sessions:
            sessions[c["session"]] = b.string(c["session"])
        cells.append(b.table({
            0: ("I", c["cell"]), 1: ("struct", struct.pack("<4Q", *[c["hash"][f"word{i}"] for i in range(4)])),
            2: ("Q", c["added"]), 3: ("Q", c["moved"]), 4: ("struct", doubles(c["t_map_cell"], POSE)),
            5: ("ref", sessions[c["session"]]), 6: ("I", c["sequence"]), 7: ("I", c["planes"]),
            8: ("Q", c["encoded_bytes"])}))
    fields = {0: ("H", VERSION), 1: ("Q", t["since"]), 2: ("Q", t["revision"]), 3: ("ref", b.offsets(cells))}
    def ids(column):
        return b.table({0: ("I", column["count"]), 1: ("ref", b.vector(bytes(column["ids"]), len(column["ids"]), 1))})

    if "moved" in t:
        parts = [ids(t["moved"]["cells"])]
        parts += [b.vector(bytes(t["moved"][name]), len(t["moved"][name]), 1) for name in COLUMNS]
        fields[4] = ("ref", b.table({i: ("ref", part) for i, part in enumerate(parts)}))
    if "removed" in t:
        fields[5] = ("ref", ids(t["removed"]))
    fields[6] = ("ref", b.offsets([canonical_constraint(b, c) for c in t["added_constraints"]]))
    for ident, name in ((7, "removed_constraints"), (8, "unaligned")):
        if name in t:
            fields[ident] = ("ref", ids(t[name]))
    if "judged" in t:
        judged = t["judged"]
        parts = [ids(judged["constraints"]), b.vector(struct.pack(f"<{len(judged['weight'])}d", *judged["weight"]),
                                                      len(judged["weight"]), 8),
                 b.vector(bytes(judged["pinned"]), len(judged["pinned"]), 1)]
        fields[9] = ("ref", b.table({i: ("ref", part) for i, part in enumerate(parts)}))
    return b.finish(b.table(fields), b"CCHG")


def canonical_scan(t):
    b = Builder()
    x, y, z = [b.vector(floats(t[axis]), len(t[axis]), 4) for axis in "xyz"]
    root = b.table({0: ("H", VERSION), 1: ("Q", t["index"]), 2: ("q", t["stamp_ns"]),
                    3: ("struct", doubles(t["t_odom_sensor"], POSE)), 4: ("ref", x), 5: ("ref", y), 6: ("ref", z)})
    return b.finish(root, b"CSCN")


# --- The content hash ------------------------------------------------------------------------------------

def hash_position(data, ident=1):
    root = struct.unpack_from("<I", data, 0)[0]
    vtable = root - struct.unpack_from("<i", data, root)[0]
    return root + struct.unpack_from("<H", data, vtable + 4 + 2 * ident)[0]


def seal(data):
    at = hash_position(data)
    blank = data[:at] + bytes(32) + data[at + 32:]
    return data[:at] + hashlib.sha256(blank).digest() + data[at + 32:]


def seal_coded(data, t):
    """The coarse hash, then the content hash over it."""
    at, content = hash_position(data, 2), hash_position(data)
    end = data.rindex(bytes(t["data"])) + t["coarse_bytes"] if t["data"] else len(data)
    blank = data[:content] + bytes(32) + data[content + 32:]
    return seal(data[:at] + hashlib.sha256(blank[:end]).digest() + data[at + 32:])


def flatc(schema, twin):
    twin = {name: value for name, value in twin.items() if name != "decoded"}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "twin.json").write_text(json.dumps(twin))
        subprocess.run(["flatc", "--binary", "-I", SCHEMA, "-o", folder, SCHEMA / f"{schema}.fbs",
                        Path(folder, "twin.json")], check=True)
        return next(p for p in Path(folder).iterdir() if p.suffix != ".json").read_bytes()


# --- What the files say ----------------------------------------------------------------------------------

def as_float32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def pose(x, y, z, yaw, roll=0.0):
    cy, sy, cr, sr = math.cos(yaw), math.sin(yaw), math.cos(roll), math.sin(roll)
    return dict(zip(POSE, [cy, -sy * cr, sy * sr, x, sy, cy * cr, -cy * sr, y, 0.0, sr, cr, z]))


def facing_plane(d, k):
    """A plane whose normal leans up to 40 degrees away from the line of sight `d`."""
    lean = [0.4 * math.cos(k), 0.4 * math.sin(2.0 * k), 0.3 * math.cos(3.0 * k)]
    n = [-u + v for u, v in zip(d, lean)]
    norm = math.sqrt(sum(v * v for v in n))
    nx, ny, nz = [as_float32(v / norm) for v in n]
    return {"distance": as_float32(3.0 + 1.7 * k), "nx": nx, "ny": ny, "nz": nz}


def cell(size, indices, kind="Fibonacci", **rest):
    if kind == "Fibonacci":
        directions = [lattice_direction(index, size) for index in indices]
    else:
        everywhere = [direction for direction, _, _ in bands(size)]
        directions = [everywhere[index] for index in indices]
    return {"version": VERSION, "content_hash": {f"word{i}": 0 for i in range(4)},
            "lattice": {"kind": kind, "version": 1, "size": size}, "indices": indices,
            "planes": [facing_plane(d, k) for k, d in enumerate(directions)], **rest}


CELLS = {
    "street": cell(50_000, [0, 1, 2, 999] + list(range(12_345, 40_000, 881)) + [49_998, 49_999],
                   session="kitti-00_2011.10.03", sequence=41, t_odom_cell=pose(123.456, -78.9, 1.25, 2.5, 0.03),
                   first_stamp_ns=1317617735123456789, last_stamp_ns=1317617736023456789, first_scan=410,
                   scan_count=10, statistics={
                       "points": 5_000_000_000, "points_in_planes": 4_000_000_000, "patches_hit": 61,
                       "rejected_few_points": 9, "rejected_gap": 8, "rejected_planarity": 7, "rejected_grazing": 1}),
    "empty": cell(1_000, [], session="e", t_odom_cell=pose(0.0, 0.0, 0.0, 0.0)),
    "largest-lattice": cell(1_000_000, [0, 499_999, 999_999], session="A.b_C-9", sequence=4_294_967_295,
                            t_odom_cell=pose(-1e6, 2e6, -3e3, -3.0), first_stamp_ns=-2**63, last_stamp_ns=2**63 - 1,
                            first_scan=4_294_967_295, scan_count=1),
    "released-lattice": cell(50_000, [0, 1] + list(range(5_000, 42_500, 1_873)) + [42_512, 42_513, 42_561, 42_562],
                             kind="FibonacciBands", session="released", sequence=3,
                             t_odom_cell=pose(5.0, -6.0, 7.0, 0.5), first_stamp_ns=10, last_stamp_ns=20, scan_count=9),
}


# --- Coded CELLs ------------------------------------------------------------------------------------------

def spheres(kind, size):
    if kind == "Fibonacci":
        return [coded_cell.Sphere(size, size, 1, 0, list(range(size)), [lattice_direction(i, size) for i in range(size)])]
    found, first = {}, 0
    for direction, points, i in bands(size):
        found.setdefault(points, []).append((i, direction))
    result = []
    for points in (size, 2 * size, size // 200):
        rows = found.get(points, [])
        result.append(coded_cell.Sphere(points, points - 1, 0, first, [i for i, _ in rows], [d for _, d in rows]))
        first += len(rows)
    return result


def room_plane(d, index):
    """A wall or the ground of a room as seen along `d`, leaning a little by the index; None where there is nothing."""
    walls = [(8.0, 0.0, 0.0), (-5.0, 0.0, 0.0), (0.0, 6.0, 0.0), (0.0, -4.0, 0.0), (0.0, 0.0, -1.8)]
    ranges = [(coded_cell.dot(w, w) / coded_cell.dot(w, d), w) for w in walls if coded_cell.dot(w, d) > 1e-3]
    if d[2] > 0.3 or not ranges or index % 11 == 3:
        return None
    distance, wall = min(ranges)
    if index % 5 == 0:  # what stands before the wall
        distance, lean = distance * (0.3 + 0.1 * (index % 7)), [math.sin(2.0 * index + i) for i in range(3)]
    else:
        lean = [0.02 * math.sin(1.0 * index + 2 * i) for i in range(3)]
    n = [-w / math.sqrt(coded_cell.dot(wall, wall)) + v for w, v in zip(wall, lean)]
    if index % 97 == 1:  # grazes its patch
        side = math.sqrt(d[0] * d[0] + d[1] * d[1])
        n = [-1e-3 * d[0] - d[1] / side, -1e-3 * d[1] + d[0] / side, -1e-3 * d[2]]
    size = math.sqrt(coded_cell.dot(n, n))
    n = [as_float32(v / size) for v in n]
    return (as_float32(distance), *n) if coded_cell.dot(n, d) < -5e-4 else None


def coded(name, encoding, bound_um, kind, size, visible, **rest):
    lattice, planes = spheres(kind, size), {}
    for sphere in lattice:
        for k, direction in enumerate(sphere.directions):
            plane = room_plane(direction, sphere.first + k) if visible(sphere.first + k) else None
            if plane:
                planes[sphere.first + k] = plane
    layers, decoded = (coded_cell.encode_packed(lattice, planes) if encoding == "Packed"
                       else coded_cell.encode_compact(lattice, planes, bound_um, 2 if encoding == "Compact2" else 1))

    def as_twin(columns):
        return [dict(zip(("distance", "nx", "ny", "nz"), columns[index])) for index in sorted(columns)]

    indices = sorted(planes)
    coarse = [sphere.first + k for sphere in lattice for k, p in enumerate(sphere.points)
              if p % 4 == 0 and sphere.first + k in planes]
    header = {"lattice": {"kind": kind, "version": 1, "size": size}, "session": name,
              "t_odom_cell": pose(1.0, -2.0, 0.5, 0.25), **rest}
    raw = canonical_cell({**header, "indices": indices, "planes": as_twin(planes)})
    words = struct.unpack_from("<4Q", raw, hash_position(raw))
    return {"data": list(b"".join(layers)), "version": VERSION, **{
        field: {f"word{i}": 0 for i in range(4)} for field in ("content_hash", "coarse_hash")},
        "raw_hash": {f"word{i}": word for i, word in enumerate(words)}, "encoding": encoding, "bound_um": bound_um,
        **header, "plane_count": len(planes), "coarse_plane_count": len(coarse), "coarse_bytes": len(layers[0]),
        "decoded": {"indices": indices, "coarse_indices": coarse, "source": as_twin(planes), "planes": as_twin(decoded)}}


CODED_CELLS = {
    "room-packed": lambda name: coded(name, "Packed", 0, "Fibonacci", 1_000, lambda i: True, sequence=3,
                                      first_stamp_ns=-7, last_stamp_ns=1317617735123456789, first_scan=4, scan_count=9),
    "room-10mm": lambda name: coded(name, "Compact", 10_000, "Fibonacci", 1_000, lambda i: True, scan_count=1),
    "part-of-a-room-20mm": lambda name: coded(name, "Compact", 20_000, "Fibonacci", 50_000,
                                              lambda i: 26_000 <= i < 26_900 or i in (0, 4, 49_999), sequence=1),
    "bands-50mm": lambda name: coded(name, "Compact", 50_000, "FibonacciBands", 1_000, lambda i: True),
    "bands-packed": lambda name: coded(name, "Packed", 0, "FibonacciBands", 1_000, lambda i: i % 3 != 0),
    "nothing-packed": lambda name: coded(name, "Packed", 0, "Fibonacci", 1_000, lambda i: False),
    "nothing-1mm": lambda name: coded(name, "Compact", 1_000, "Fibonacci", 1_000, lambda i: False),
    "room-10mm-2": lambda name: coded(name, "Compact2", 10_000, "Fibonacci", 1_000, lambda i: True, scan_count=1),
    "part-of-a-room-20mm-2": lambda name: coded(name, "Compact2", 20_000, "Fibonacci", 50_000,
                                                lambda i: 26_000 <= i < 26_900 or i in (0, 4, 49_999), sequence=1),
    "bands-50mm-2": lambda name: coded(name, "Compact2", 50_000, "FibonacciBands", 1_000, lambda i: True),
    "nothing-1mm-2": lambda name: coded(name, "Compact2", 1_000, "Fibonacci", 1_000, lambda i: False),
}


def information(weight):
    """Positive definite: a heavy diagonal and small numbers beside it."""
    return {name: weight * (10.0 + i) if name[1] == name[2] else weight * 0.125 * math.sin(i)
            for i, name in enumerate(INFORMATION)}


def scores(points, hits):
    return {"points": points, "hits": hits, "inlier_ratio_all": 0.375, "inlier_ratio_hit": 0.9321,
            "share_in_front": 0.004, "share_beyond": 0.0625, "median_residual_m": 0.0451}


GRAPHS = {
    "three-cells": {
        "version": VERSION, "revision": 17,
        "nodes": [{"cell": c, "t_map_cell": pose(6.1 * c, 0.5 * c, 0.01 * c, 0.1 * c)} for c in (1, 2, 4_000_000_000)],
        "constraints": [
            {"id": 1, "from": 1, "to": 2, "kind": "Odometry", "origin": "Mapper",
             "t_from_to": pose(6.1, 0.5, 0.01, 0.1), "information": information(1.0)},
            {"id": 2, "from": 2, "to": 4_000_000_000, "kind": "Bidirectional", "origin": "Detection",
             "t_from_to": pose(5.9, -0.5, 0.0, 0.2), "information": information(250.0), "scores": scores(120_000, 99_000)},
            {"id": 9, "from": 4_000_000_000, "to": 1, "kind": "Loop", "origin": "User",
             "t_from_to": pose(-1.0, 2.0, 0.1, 3.1), "information": information(0.001), "scores": scores(7, 7)}]},
    "empty-map": {"version": VERSION, "revision": 0, "nodes": [], "constraints": []},
}
GRAPHS["judged-loops"] = {
    "version": VERSION, "revision": 18, "nodes": GRAPHS["three-cells"]["nodes"],
    "constraints": [{**GRAPHS["three-cells"]["constraints"][2], "id": 10 + i, **judged} for i, judged in enumerate(
        [{"weight": 0.0}, {"weight": 0.34375}, {"pinned": True}, {"weight": 0.0, "pinned": True}])]}

# --- Changes: columns and the grid of poses, from FORMAT.md --------------------------------------------

COLUMNS = ["x", "y", "z", "rx", "ry", "rz"]


def column(values):
    folded = []
    for i, value in enumerate(values):
        expected = 0 if i == 0 else values[0] if i == 1 else 2 * values[i - 1] - values[i - 2]
        rest = value - expected
        folded.append(2 * rest if rest >= 0 else -2 * rest - 1)
    width = (max(folded).bit_length() + 7) // 8
    return [value >> (8 * plane) & 255 for plane in range(width) for value in folded]


def grid_pose(g):
    """The exact evaluation: Python's floats are binary64 and round after each operation."""
    x, y, z = [v * 2.0**-22 for v in g[3:]]
    xx, yy, zz = x * x, y * y, z * z
    s = xx + yy + zz
    d, c = (1 + s) * (1 + s), 4 * (1 - s)
    rows = [1 - 8 * (yy + zz) / d, (8 * x * y - c * z) / d, (8 * x * z + c * y) / d, g[0] * 2.0**-13,
            (8 * x * y + c * z) / d, 1 - 8 * (xx + zz) / d, (8 * y * z - c * x) / d, g[1] * 2.0**-13,
            (8 * x * z - c * y) / d, (8 * y * z + c * x) / d, 1 - 8 * (xx + yy) / d, g[2] * 2.0**-13]
    check_rotation(g, rows)
    return dict(zip(POSE, rows))


def check_rotation(g, rows):
    """The same from the definition: the parameters are axis * tan(angle / 4)."""
    p = [v / 2**22 for v in g[3:]]
    norm = math.sqrt(sum(v * v for v in p))
    angle = 4 * math.atan(norm)
    ux, uy, uz = [v / norm for v in p] if norm else [1.0, 0.0, 0.0]
    cos, sin, k = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    expected = [cos + ux * ux * k, ux * uy * k - uz * sin, ux * uz * k + uy * sin,
                uy * ux * k + uz * sin, cos + uy * uy * k, uy * uz * k - ux * sin,
                uz * ux * k - uy * sin, uz * uy * k + ux * sin, cos + uz * uz * k]
    found = [rows[i] for i in range(12) if i % 4 != 3]
    assert max(abs(u - v) for u, v in zip(found, expected)) < 1e-14, (g, found, expected)


def changes(since, revision, moved, added=(), constraints=(), judged=None, **id_lists):
    """moved: CELL -> six coordinates of the grid; id_lists: removed, removed_constraints, unaligned. What the columns
    become is in "decoded", for readers of the twin; flatc never sees it."""
    def ids(values):
        return {"count": len(values), "ids": column(values)}

    decoded = dict(id_lists)
    if judged:
        decoded["judged"] = [dict(zip(("id", "weight", "pinned"), row)) for row in judged]
    twin = {"version": VERSION, "since": since, "revision": revision, "added": list(added),
            "added_constraints": list(constraints), **{name: ids(values) for name, values in id_lists.items()}}
    if judged:
        columns = [list(column) for column in zip(*judged)]
        twin["judged"] = {"constraints": ids(columns[0]), "weight": columns[1], "pinned": columns[2]}
    if moved:
        twin["moved"] = {"cells": ids(sorted(moved)), **{name: column([moved[cell][i] for cell in sorted(moved)])
                                                        for i, name in enumerate(COLUMNS)}}
    return {**twin, "decoded": {"moved": [{"cell": cell, "t_map_cell": grid_pose(moved[cell])}
                                          for cell in sorted(moved)], **decoded}}


def added_cell(cell, revision, session):
    return {"cell": cell, "hash": {f"word{i}": 0x0123456789ABCDEF ^ (cell << 4 * i) for i in range(4)},
            "added": revision, "moved": revision + 1, "t_map_cell": pose(1.5 * cell, -3.0, 0.25, 0.3),
            "session": session, "sequence": cell - 1, "planes": 5_612, "encoded_bytes": 112_640}


CHANGES = {
    # A lane driven there and back: the rotation passes half a turn, where its parameters change sign.
    "after-a-loop": changes(
        41, 44,
        {c: [49_152 * c, 800 * c * c - 3, -7 * c,
             round(2**22 * 0.01 * math.sin(c)), round(2**22 * 0.003),
             round(2**22 * math.tan((0.2 * c + math.pi) % (2 * math.pi) / 4 - math.pi / 4))] for c in range(1, 33)},
        constraints=GRAPHS["three-cells"]["constraints"][1:], removed_constraints=[5, 4_294_967_295]),
    "extremes": changes(
        0, 2**63, {0: [2**37, -2**37, 0, 2**22 - 1, 0, 0], 7: [-2**37, 2**37, 1, 0, 0, 1 - 2**22],
                   4_294_967_295: [0, 0, 0, 0, 0, 0]},
        added=[added_cell(1, 1, "monday"), added_cell(2, 2, "tuesday"), added_cell(4_000_000_000, 3, "monday")],
        removed=[3, 4_294_967_294], removed_constraints=[0], unaligned=list(range(1_000, 1_300))),
    # Valid, but a writer takes the other name of the same rotation, within half a turn.
    "beyond-half-a-turn": changes(1, 2, {5: [1, 2, 3, 2**22, -2**22, 2**22], 6: [1, 2, 3, 0, 0, -2**22]}),
    "no-changes": changes(17, 17, {}),
    "judged-anew": changes(17, 18, {}, judged=[(1, 0.0, False), (7, 0.34375, False), (4_294_967_295, 1.0, True)]),
}

SCANS = {
    "with-nan": {"version": VERSION, "index": 5_000_000_000, "stamp_ns": -1, "t_odom_sensor": pose(1.0, 2.0, 3.0, 0.7),
                 "x": [1.5, "nan", -0.25, 3.0], "y": [as_float32(0.1), 2.0, "-inf", 0.0],
                 "z": [as_float32(-1.73), 0.5, 1.0, "inf"]},
    "no-points": {"version": VERSION, "index": 0, "stamp_ns": 0, "t_odom_sensor": pose(0.0, 0.0, 0.0, 0.0),
                  "x": [], "y": [], "z": []},
}


def lattice_vectors():
    rows = []
    for size in (1_000, 20_000, 50_000, 1_000_000):
        for i in sorted({0, 1, 2, 12, 233, 377, size // 3, size // 2 - 1, size // 2, size - 2, size - 1}):
            direction = lattice_direction(i, size)
            check_lattice(i, size, direction)
            rows.append({"kind": "fibonacci", "size": size, "index": i, "direction": list(direction)})
    return rows


def band_vectors():
    for size in (1_000, 20_000, 50_000):
        directions = list(bands(size))
        count = len(directions)
        borders = [k for k in range(1, count) if directions[k - 1][1] != directions[k][1]]
        for index in sorted({0, 1, 233, count // 3, count // 2, *borders, *[k - 1 for k in borders], count - 1}):
            direction, points, i = directions[index]
            check_band(direction, points, i)
            yield {"kind": "fibonacci-bands", "size": size, "count": count, "index": index,
                   "direction": list(direction)}


def all_files():
    for name, twin in CELLS.items():
        data = seal(flatc("cell", twin))
        words = struct.unpack_from("<4Q", data, hash_position(data))
        twin = {**twin, "content_hash": {f"word{i}": word for i, word in enumerate(words)}}
        assert flatc("cell", twin) == data, "the twin with its hash gives the same file"
        yield f"{name}.json", json.dumps(twin, indent=1).encode() + b"\n"
        yield f"{name}.cell", data
        yield f"{name}.canonical.cell", canonical_cell(twin)
    for name, make in CODED_CELLS.items():
        twin = make(name)
        rows = ",\n ".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in twin.items())
        yield f"{name}.json", f"{{{rows}}}\n".encode()
        yield f"{name}.ccod", seal_coded(flatc("coded_cell", twin), twin)
        yield f"{name}.canonical.ccod", canonical_coded_cell(twin)
    for schema, suffix, twins, canonical in (("pose_graph", "cpgr", GRAPHS, canonical_pose_graph),
                                             ("changes", "cchg", CHANGES, canonical_changes),
                                             ("scan", "cscn", SCANS, canonical_scan)):
        for name, twin in twins.items():
            yield f"{name}.json", json.dumps(twin, indent=1).encode() + b"\n"
            yield f"{name}.{suffix}", flatc(schema, twin)
            yield f"{name}.canonical.{suffix}", canonical(twin)
    for name, vectors in (("lattice-directions", lattice_vectors()), ("band-directions", band_vectors())):
        rows = ",\n ".join(json.dumps(row) for row in vectors)
        yield f"{name}.json", f"[{rows}]\n".encode()


def main():
    changed = []
    for name, data in all_files():
        path = HERE / "v1" / name
        if "--check" in sys.argv[1:]:
            if not path.exists() or path.read_bytes() != data:
                changed.append(name)
        else:
            path.write_bytes(data)
    if changed:
        print("these files would change: " + ", ".join(changed))
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
