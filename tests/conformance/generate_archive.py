#!/usr/bin/env python3
"""Writes the conformance archives of format version 1 without any code of the library: FlatBuffers by the builder of
generate.py, zstd frames of raw blocks, XXH3 from its specification.

Usage: generate_archive.py            writes into v1/ beside this file
       generate_archive.py --check    writes nothing, exits 1 where a file would change
"""
import json
import struct
import sys

from generate import (HERE, POSE, VERSION, Builder, canonical_cell, canonical_changes, canonical_pose_graph, cell,
                      changes, column, doubles, hash_position, information, pose, scores)

# --- XXH3, 64 bits, seed 0 -------------------------------------------------------------------------------

MASK = 2**64 - 1
P32 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
P64 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5
SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221"
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb"
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e")


def read(data, at, kind="Q"):
    return struct.unpack_from("<" + kind, data, at)[0]


def xor_shift(value, bits):
    return value ^ value >> bits


def avalanche(value):
    return xor_shift(xor_shift(value, 37) * 0x165667919E3779F9 & MASK, 32)


def avalanche_64(value):
    value = xor_shift(value, 33) * P64[1] & MASK
    return xor_shift(xor_shift(value, 29) * P64[2] & MASK, 32)


def fold(a, b):
    return (a * b & MASK) ^ (a * b >> 64)


def mix(data, at, secret):
    return fold(read(data, at) ^ read(SECRET, secret), read(data, at + 8) ^ read(SECRET, secret + 8))


def xxh3_short(data):
    n = len(data)
    if n == 0:
        return avalanche_64(read(SECRET, 56) ^ read(SECRET, 64))
    if n <= 3:
        combined = data[0] << 16 | data[n >> 1] << 24 | data[n - 1] | n << 8
        return avalanche_64(combined ^ read(SECRET, 0, "I") ^ read(SECRET, 4, "I"))
    if n <= 8:
        value = (read(data, n - 4, "I") + (read(data, 0, "I") << 32)) ^ read(SECRET, 8) ^ read(SECRET, 16)
        rotated = [(value << k | value >> 64 - k) & MASK for k in (49, 24)]
        value = (value ^ rotated[0] ^ rotated[1]) * 0x9FB21C651E98DF25 & MASK
        value = (value ^ (value >> 35) + n) * 0x9FB21C651E98DF25 & MASK
        return xor_shift(value, 28)
    low = read(data, 0) ^ read(SECRET, 24) ^ read(SECRET, 32)
    high = read(data, n - 8) ^ read(SECRET, 40) ^ read(SECRET, 48)
    swapped = int.from_bytes(low.to_bytes(8, "little"), "big")
    return avalanche((n + swapped + high + fold(low, high)) & MASK)


def xxh3_middle(data):
    n = len(data)
    total = n * P64[0]
    if n <= 128:
        for k in range((n - 1) // 32 + 1):
            total += mix(data, 16 * k, 32 * k) + mix(data, n - 16 - 16 * k, 32 * k + 16)
        return avalanche(total & MASK)
    total = avalanche((total + sum(mix(data, 16 * k, 16 * k) for k in range(8))) & MASK)
    total += sum(mix(data, 16 * k, 16 * (k - 8) + 3) for k in range(8, n // 16))
    return avalanche((total + mix(data, n - 16, 136 - 17)) & MASK)


def xxh3_long(data):
    n = len(data)
    lanes = [P32[2], *P64[:4], P32[1], P64[4], P32[0]]

    def accumulate(at, secret):
        for k in range(8):
            value = read(data, at + 8 * k)
            key = value ^ read(SECRET, secret + 8 * k)
            lanes[k ^ 1] = (lanes[k ^ 1] + value) & MASK
            lanes[k] = (lanes[k] + (key & 0xFFFFFFFF) * (key >> 32)) & MASK

    blocks = (n - 1) // 1024
    for block in range(blocks):
        for k in range(16):
            accumulate(1024 * block + 64 * k, 8 * k)
        for k in range(8):
            lanes[k] = (xor_shift(lanes[k], 47) ^ read(SECRET, 128 + 8 * k)) * P32[0] & MASK
    for k in range((n - 1 - 1024 * blocks) // 64):
        accumulate(1024 * blocks + 64 * k, 8 * k)
    accumulate(n - 64, 192 - 64 - 7)
    total = n * P64[0] + sum(fold(lanes[2 * k] ^ read(SECRET, 11 + 16 * k), lanes[2 * k + 1] ^ read(SECRET, 19 + 16 * k))
                             for k in range(4))
    return avalanche(total & MASK)


def xxh3(data):
    return xxh3_short(data) if len(data) <= 16 else xxh3_middle(data) if len(data) <= 240 else xxh3_long(data)


# --- The parts of an archive, from FORMAT.md, "Archive" --------------------------------------------------

def zstd(data):
    """A frame that declares its size, of raw blocks (RFC 8878)."""
    frame = bytes.fromhex("28b52ffd") + b"\xe0" + struct.pack("<Q", len(data))
    pieces = [data[i:i + 100_000] for i in range(0, len(data), 100_000)] or [b""]
    for i, piece in enumerate(pieces):
        frame += (len(piece) << 3 | (i == len(pieces) - 1)).to_bytes(3, "little") + piece
    return frame


def padded(data):
    return data + bytes(-len(data) % 8)


def sealed(data):
    return data + struct.pack("<Q", xxh3(data))


def head(size, cells=0, records_end=0, data_end=0, root=b"", leaves=0):
    return sealed(b"\x89CELLMAP" + struct.pack("<HBBIQQQIIQ", VERSION, 1, 1, size, cells, records_end, data_end, len(root),
                                               leaves, xxh3(root)))


def state(serial, block, footer_offset, footer):
    end = footer_offset + len(padded(footer)) + 72
    return sealed(struct.pack("<7Q", serial, block, footer_offset, len(footer), xxh3(footer), end, 0))


def record(ident, payload):
    first = b"\x89CELL\r\n\x1a" + struct.pack("<IIQI", ident, len(payload), xxh3(payload), 1)
    return first + struct.pack("<I", xxh3(first) & 0xFFFFFFFF) + payload


def add_columns(b, columns):
    """id -> ("ref", ...) of vectors of bytes."""
    packed = {ident: bytes(column(values)) if values else b"" for ident, values in columns.items()}
    return {ident: ("ref", b.vector(data, len(data), 1)) for ident, data in packed.items()}


def directory(rows, begin, checksums=None):
    """rows: (id, offset, bytes)."""
    b, gaps = Builder(), []
    for _, offset, length in rows:
        gaps.append((offset - begin) // 8)
        begin = offset + length + -length % 8
    fields = add_columns(b, {2: [r[0] for r in rows], 3: gaps, 4: [r[2] for r in rows]})
    if checksums:
        fields[5] = ("ref", b.vector(struct.pack(f"<{len(checksums)}Q", *checksums), len(checksums), 8))
    return zstd(b.finish(b.table({0: ("H", VERSION), 1: ("I", len(rows)), **fields}), b"CADR"))


def list_of_cells(cells):
    b = Builder()
    hashes = b"".join(c["hash"] for c in cells)
    vector = b.vector(hashes, len(cells), 8)
    names = {2: "id", 4: "session", 5: "sequence", 6: "planes", 7: "bytes"}
    fields = add_columns(b, {ident: [c[name] for c in cells] for ident, name in names.items()})
    return zstd(b.finish(b.table({0: ("H", VERSION), 1: ("I", len(cells)), 3: ("ref", vector), **fields}), b"CACL"))


def list_of_scans(stretches):
    """stretches: id, raw_points, voxel_points, t_odom_cell, scans: (stamp, pose). Exact poses."""
    b = Builder()
    scans = [scan for s in stretches for scan in s["scans"]]
    poses = [s["t_odom_cell"] for s in stretches] + [pose for _, pose in scans]
    vector = b.vector(b"".join(doubles(p, POSE) for p in poses), len(poses), 8)
    fields = add_columns(b, {2: [s["id"] for s in stretches], 3: [len(s["scans"]) for s in stretches],
                             4: [s["raw_points"] for s in stretches], 5: [s["voxel_points"] for s in stretches],
                             6: [stamp for stamp, _ in scans]})
    return zstd(b.finish(b.table({0: ("H", VERSION), 1: ("I", len(stretches)), 7: ("ref", vector), **fields}), b"CASC"))


def footer(t, sections):
    b = Builder()
    place = t["georeference"]
    georeference = b.table({0: ("d", place["latitude_deg"]), 1: ("d", place["longitude_deg"]), 2: ("d", place["height_m"]),
                            3: ("struct", doubles(place["t_enu_map"], POSE))})
    sessions = []
    for s in t["sessions"]:
        texts = {i: ("ref", b.string(s[name])) for i, name in enumerate(["name", "robot", "sensor", "odometry_frame"])
                 if s.get(name)}
        sessions.append(b.table({**texts, 4: ("q", s.get("started_ns", 0))}))
    wire_sessions = b.offsets(sessions)
    wire_sections = b.offsets([b.table({0: ("B", kind), 1: ("Q", at), 2: ("Q", len(data)), 3: ("Q", xxh3(data))})
                               for kind, at, data in sections])
    lattice = b.table({0: ("B", 1), 1: ("B", 1), 2: ("I", t["lattice_size"])})
    root = b.table({0: ("H", VERSION), 1: ("ref", b.string(t["map"])), 2: ("q", t["created_ns"]), 3: ("ref", lattice),
                    4: ("B", 1), 6: ("Q", t["revision"]), 7: ("Q", len(t["cells"])),
                    8: ("Q", sum(c["planes"] for c in t["cells"])), 9: ("Q", sum(c["bytes"] for c in t["cells"])),
                    10: ("Q", sum(len(s["scans"]) for s in t["scans"])), 11: ("ref", wire_sessions),
                    12: ("ref", georeference), 13: ("ref", wire_sections)})
    return b.finish(root, b"CAFT")


def archive(t, leaves=False, update=None, unfinished=b""):
    """t: what it holds. update: changes for a second block, and the revision that they lead to."""
    body, rows = b"", []
    for c in t["cells"]:
        data = record(c["id"], zstd(c["data"]))
        rows.append((c["id"], 16384 + len(body), len(data)))
        body += padded(data)
    records_end = 16384 + len(body)
    root = directory(rows, 16384)
    if leaves:
        parts, places, sums = [rows[:2], rows[2:]], [], []
        for part in parts:
            leaf = directory(part, 16384)
            places.append((part[0][0], 16384 + len(body), len(leaf)))
            sums.append(xxh3(leaf))
            body += padded(leaf)
        root = directory(places, records_end, sums)
    data_end = 16384 + len(body)
    sections = []
    for kind, data in ((1, zstd(canonical_pose_graph(t["graph"]))), (4, list_of_scans(t["scans"])),
                       (3, list_of_cells(t["cells"]))):
        sections.append((kind, 16384 + len(body), data))
        body += padded(data)
    states = [append(t, sections, data_end, 1)]
    body += states[0][1]
    if update:
        old_footer = 16384 + len(body) - len(states[0][1])
        sections.append((5, old_footer, states[0][1]))
        block = 16384 + len(body)
        sections.append((2, block, zstd(canonical_changes(update))))
        body += padded(sections[-1][2])
        states.append(append({**t, "revision": update["revision"]}, sections, block, 2))
        body += states[1][1]
    slots = {1024: states[0][0], 512: states[1][0] if update else bytes(64)}
    first = head(t["lattice_size"], len(rows), records_end, data_end, root, int(leaves))
    first += bytes(512 - len(first)) + slots[512]
    first += bytes(1024 - len(first)) + slots[1024]
    first += bytes(1536 - len(first)) + root
    return first + bytes(16384 - len(first)) + body + unfinished


def append(t, sections, block, serial):
    """The state, and footer and tail that lie behind the sections."""
    data = footer(t, sections)
    at = sections[-1][1] + len(padded(sections[-1][2]))
    entry = state(serial, block, at, data)
    return entry, padded(data) + entry + b"PAMLLEC\x89"


# --- What the files say ----------------------------------------------------------------------------------

def town():
    cells, scans = [], []
    for k, ident in enumerate((3, 4, 1000)):
        twin = cell(1_000, [10 * k, 400 + k, 998] if k else [], session="monday" if k < 2 else "tuesday", sequence=k % 2,
                    t_odom_cell=pose(6.0 * k, 0.25, 0.0, 0.1 * k), first_stamp_ns=1000 * k, last_stamp_ns=1000 * k + 200,
                    first_scan=3 * k, scan_count=3)
        data = canonical_cell(twin)
        at = hash_position(data)
        cells.append({"id": ident, "session": int(k == 2), "sequence": k % 2, "planes": len(twin["indices"]),
                      "bytes": len(data), "hash": data[at:at + 32], "data": data})
        if k == 1:
            continue  # a CELL without scans
        scans.append({"id": ident, "raw_points": 300_000 + k, "voxel_points": 5_000 - k, "t_odom_cell": twin["t_odom_cell"],
                      "scans": [(1000 * k + 100 * i, pose(2.0 * i, 0.01 * i, 0.0, 0.02 * i)) for i in range(3)]})
    graph = {"version": VERSION, "revision": 12,
             "nodes": [{"cell": c["id"], "t_map_cell": pose(6.1 * k, 0.5, 0.01, 0.1)} for k, c in enumerate(cells)],
             "constraints": [{"id": 5, "from": 3, "to": 4, "kind": "Bidirectional", "origin": "Mapper",
                              "t_from_to": pose(6.1, 0.5, 0.01, 0.1), "information": information(9.0),
                              "scores": scores(100, 90)}]}
    return {"map": "town", "created_ns": 1_700_000_000_123_456_789, "lattice_size": 1_000, "revision": 12, "cells": cells,
            "scans": scans, "graph": graph,
            "sessions": [{"name": "monday", "robot": "r7", "sensor": "OS1-64", "odometry_frame": "r7/odom",
                          "started_ns": 1_690_000_000_000_000_000}, {"name": "tuesday"}],
            "georeference": {"latitude_deg": 49.0, "longitude_deg": 8.4, "height_m": 116.5,
                             "t_enu_map": pose(0.0, 0.0, 0.0, 0.3)}}


def twin_of(t, update=None):
    moved = {row["cell"]: row["t_map_cell"] for row in update["decoded"]["moved"]} if update else {}
    cells = [{**{name: c[name] for name in ("id", "sequence", "planes", "bytes")}, "hash": c["hash"].hex(),
              "session": t["sessions"][c["session"]]["name"],
              "t_map_cell": moved.get(c["id"], node["t_map_cell"])} for c, node in zip(t["cells"], t["graph"]["nodes"])]
    constraints = len(t["graph"]["constraints"]) + len(update["added_constraints"] if update else [])
    scans = [{**s, "scans": [{"stamp_ns": stamp, "t_cell_scan": p} for stamp, p in s["scans"]]} for s in t["scans"]]
    return {"map": t["map"], "created_ns": t["created_ns"], "lattice_size": t["lattice_size"],
            "revision": update["revision"] if update else t["revision"], "sessions": t["sessions"],
            "georeference": t["georeference"], "constraints": constraints, "cells": cells, "scans": scans}


def all_files():
    t = town()
    update = changes(12, 15, {4: [49_152, -3, 7, 0, 0, 2**20], 1000: [98_304, 5, -9, 12, 0, 2**19]},
                     constraints=[{**t["graph"]["constraints"][0], "id": 6, "from": 1000, "to": 3, "kind": "Loop"}],
                     unaligned=[1000])
    for name, data, twin in (("three-cells", archive(t), twin_of(t)),
                             ("with-leaves", archive(t, leaves=True), twin_of(t)),
                             ("updated", archive(t, update=update), {**twin_of(t, update), "unaligned": [1000]}),
                             ("half-updated", archive(t, unfinished=b"an update that was cut off"), twin_of(t))):
        yield f"{name}.cellmap", data
        yield f"{name}.cellmap.json", json.dumps(twin, indent=1).encode() + b"\n"


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
