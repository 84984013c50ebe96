#!/usr/bin/env python3
"""Makes FOLDER/TARGET/ anew with what each fuzz target begins with: files of tests/conformance, and texts from here.

Usage: make_seeds.py FOLDER"""
import json
import shutil
import struct
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "conformance"))
import coded_cell  # noqa: E402
import generate  # noqa: E402

FILES = HERE.parent / "conformance" / "v1"
SETTINGS = HERE.parent.parent / "server" / "deploy" / "cellmapd.conf"

# target: (pattern of conformance files, bytes to put before each, which part of it)
FROM_FILES = {
    "archive": [("*.cellmap", b"", slice(None))],
    "archive_parts": [("*.cellmap", b"\0", slice(0, 64)), ("*.cellmap", b"\1", slice(1024, 1088)),
                      ("*.cellmap", b"\2", slice(-1000, -72)), ("*.cellmap", b"\3", slice(-2000, None)),
                      ("*.cellmap", b"\4", slice(16384, 16416))],
    "cells": [("*.cell", b"\0", slice(None))],
    "changes": [("*.cchg", b"", slice(None))],
    "cloud_headers": [("released-folder/*.pcd", b"\0", slice(None))],
    "coded_cell": [("*.ccod", b"", slice(None))],
    "plane_pcd": [("released-folder/*.pcd", b"", slice(None))],
    "pose_graph": [("*.cpgr", b"", slice(None))],
    "scans": [("*.cscn", b"\0", slice(None))],
    "text_poses": [("released-folder/cell_odom.txt", b"\0", slice(None))],
}

KITTI_POSES = "1 0 0 0 0 1 0 0 0 0 1 0\n# a comment\n1 0 0 1.5 0 1 0 0 0 0 1 1e-3\n"
TUM_POSES = "0.000000000 0 0 0 0 0 0 1\n1567410201.745204700 1 -2.5 3e-1 0 0 0.70710678 0.70710678\n"
G2O = """VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1
"""
PLANAR_G2O = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.1\nEDGE_SE2 0 1 1 0 0.1 1 0 0 1 0 1\n"
TIMES, CALIBRATION = "0\n1.04e-01\n", "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 0.1 0 0 -1 0 1 0 0 -0.27\n"
BINARY_PCD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z rgb
SIZE 4 4 4 4
TYPE F F F U
COUNT 1 1 1 1
WIDTH 1
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 1
DATA binary
""" + "0123456789abcdef"
COMPRESSED_PCD = BINARY_PCD.replace("DATA binary", "DATA binary_compressed").replace("0123456789abcdef", "\4\0\0\0\20\0\0\0abcd")
PLY = "ply\nformat {} 1.0\ncomment c\nelement vertex 1\nproperty float x\nproperty double y\nproperty float z\nend_header\n{}"
POSE = "0.1,0,0,0,0,0,1"
UPPER_TRIANGLE = [1.0 if k in (0, 6, 11, 15, 18, 20) else 0 for k in range(21)]
BODY = f'{{"pose":[{POSE}],"matrix":{UPPER_TRIANGLE},"number":3,"text":"\\u00e9\\ud83d\\ude00","encoding":"compact","bound_m":0.02}}'
HEAD = "PUT /v1/maps/town/cells/7?hash=%61 HTTP/1.1\r\nHost: example.org:80\r\nContent-Length: 12\r\nX: a, b\r\n\r\n"
CHUNKED_HEAD = "POST / HTTP/1.1\r\nHost: [::1]\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n0\r\n\r\n"
TOKENS = """# who may ask
cart-7  sha256:{}  map:read,map:write  maps=town,harbour expires=2027-01-31T00:00:00Z rate=20
guest sha256:{} relocalise
""".format("5f" * 32, "0a" * 32)

# A byte says the kind where the target takes one (`take_kind`).
TEXTS = {
    "cloud_headers": ["\0" + BINARY_PCD, "\0" + COMPRESSED_PCD, "\1" + PLY.format("ascii", "1 -2.5 nan\n"),
                      "\1" + PLY.format("binary_little_endian", "x" * 16), "\1" + PLY.format("binary_big_endian", "x" * 16)],
    "dataset": [TIMES + "\0" + CALIBRATION + "\0" + KITTI_POSES + "\0", "\0\0" + KITTI_POSES, TIMES + "\0\0" + TUM_POSES],
    "header_values": ["\0/v1/maps/a%2Fb?near=1,2,3&radius=20.5&cursor=%41", "\1bytes=0-99", "\1bytes=-5", "\1bytes=990-",
                      "\1bytes=1-2,5-9", "\2application/json;q=0.5, */*;q=0.1", "\2gzip, zstd;q=1, identity;q=0",
                      '\2W/"abc", "def"', "\2text/html; charset=utf-8", "\3" + POSE],
    "json_body": [BODY, '["a","b"]', '{"kind":"fibonacci-bands","size":50000}', "[[[[[[[[[[[[[[[[1]]]]]]]]]]]]]]]]", "-1.5e300"],
    "request_head": [HEAD, CHUNKED_HEAD, "GET / HTTP/1.0\r\n\r\n"],
    "settings_file": [SETTINGS.read_text(), 'store = "a"\n[section]\nx = [1, 2]\n', "store = a\nlisten = [\"unix:b\", '[::]:0']\n"],
    "text_poses": ["\0" + KITTI_POSES, "\0" + TUM_POSES, "\1" + G2O, "\2" + G2O, "\1" + PLANAR_G2O],
    "token_file": [TOKENS],
}


def batched(entries, head):
    return b"".join(head(k) + struct.pack("<I", len(entry)) + entry for k, entry in enumerate(entries))


def pose_row():
    return struct.pack("<12d", 1, 0, 0, 0.5, 0, 1, 0, -2, 0, 0, 1, 3)


def coded_planes():
    """The streams of the second implementation, on the target's lattice, with what the target reads before them."""
    for kind, number in (("Fibonacci", 0), ("FibonacciBands", 2)):
        lattice = generate.spheres(kind, 1000)
        planes = {sphere.first + k: generate.room_plane(direction, sphere.first + k)
                  for sphere in lattice for k, direction in enumerate(sphere.directions) if (sphere.first + k) % 3}
        planes = {index: plane for index, plane in planes.items() if plane}
        coarse = sum(coded_cell.is_coarse(p) and sphere.first + k in planes for sphere in lattice for k, p in enumerate(sphere.points))
        encoded = {1: coded_cell.encode_packed(lattice, planes)}
        encoded.update({bit: coded_cell.encode_compact(lattice, planes, 20_000, version) for bit, version in ((0, 2), (4, 1))})
        for encoding, (layers, _) in encoded.items():
            head = struct.pack("<B3H", number + encoding, len(layers[0]), coarse, len(planes) - coarse)
            yield f"{kind}-{encoding}", head + b"".join(layers)


def bodies():
    """Bytes that take more than a file: (target, name, bytes)."""
    scan, cells = (FILES / "with-nan.cscn").read_bytes(), [p.read_bytes() for p in sorted(FILES.glob("s*.cell"))]
    yield "scans", "batch", b"\1" + batched([scan], lambda _: b"")
    yield "scans", "kitti", b"\2" + struct.pack("<8f", 1, 2, 3, 0, float("nan"), 5, 6, 1)
    yield "cells", "batch", b"\2" + batched(cells, lambda k: struct.pack("<I", k))
    # A zstd frame of one raw block: magic, one-byte content size, a last block of 5 bytes.
    yield "cells", "zstd", b"\1" + bytes.fromhex("28b52ffd2005290000") + b"hello"
    yield from (("coded_planes", name, content) for name, content in coded_planes())
    yield "store_rows", "pose", b"\0" + pose_row()
    yield "store_rows", "rotation", b"\1" + struct.pack("<9d", 1, 0, 0, 0, 1, 0, 0, 0, 1)
    yield "store_rows", "information", b"\2" + struct.pack("<36d", *[float(k % 7 == 0) for k in range(36)])
    yield "store_rows", "scores", b"\3" + struct.pack("<2I5d", 100, 90, 0.9, 0.1, 0.1, 0.05, 0.04)
    yield "store_rows", "scans", b"\4" + 2 * (struct.pack("<q", 5) + pose_row())


def drive_part():
    """A part of a drive that is one CELL, in the second implementation's layout."""
    cell, twin = (FILES / "street.cell").read_bytes(), json.loads((FILES / "street.json").read_text())
    scans, voxels, b = twin["scan_count"], [(3, 1), (4, 9), (1 << 40, (1 << 64) - 1)], generate.Builder()
    columns = {0: b.vector(cell, len(cell), 1),
               1: b.vector(struct.pack(f"<{scans}q", *range(scans)), scans, 8),
               2: b.vector(scans * pose_row(), scans, 8)}
    columns.update({4 + k: b.vector(struct.pack(f"<{len(voxels)}Q", *(v[k] for v in voxels)), len(voxels), 8) for k in (0, 1)})
    made = b.table({3: ("Q", 7), **{ident: ("ref", column) for ident, column in columns.items()}})
    cells = b.offsets([made])
    yield "drive_part", "one-cell", b.finish(b.table({0: ("H", generate.VERSION), 1: ("ref", cells)}), b"CPRT")


def place_search():
    """A query of one region whose views are nearly empty, and an answer of three places, two of them described."""
    b = generate.Builder()
    coefficients = struct.pack("<26000f", *(0.5 if k % 4096 == 7 else 0 for k in range(26000)))
    query = b.table({0: ("H", generate.VERSION), 1: ("H", 1), 2: ("Q", 9), 3: ("H", 3), 4: ("B", 1), 5: ("Q", (1 << 60) - 1),
                     6: ("ref", b.vector(coefficients, 26000, 4)),
                     7: ("ref", b.vector(struct.pack("<2iQ", -3, 4, 1 << 63), 1, 8))})
    yield "place_search", "query", b"\0" + b.finish(query, b"CPLQ")
    b = generate.Builder()
    description = b"\1" + bytes(range(200)) * 5 + bytes(100) + pose_row()
    columns = {1: b.vector(struct.pack("<2I", 1, 4), 2, 4), 2: b.vector(struct.pack("<3I", 7, 5, 6), 3, 4),
               3: b.vector(struct.pack("<3f", 0.5, 0.25, 0.25), 3, 4), 4: b.vector(struct.pack("<3f", 0.5, 0.25, 0.25), 3, 4),
               5: b.vector(3 * description, 3 * len(description), 1)}
    answer = b.finish(b.table({0: ("H", generate.VERSION), **{ident: ("ref", column) for ident, column in columns.items()}}), b"CPLR")
    yield "place_search", "answer", b"\1" + answer
    yield "place_search", "answer-after-a-first-look", b"\2" + answer


def seeds():
    for target, files in FROM_FILES.items():
        for k, (pattern, before, part) in enumerate(files):
            for file in sorted(FILES.glob(pattern)):
                yield target, f"{k}-{file.name}", before + file.read_bytes()[part]
    for target, texts in TEXTS.items():
        for k, text in enumerate(texts):
            yield target, f"text-{k}", text.encode()
    yield from bodies()
    yield from drive_part()
    yield from place_search()


def main():
    folder = Path(sys.argv[1])
    shutil.rmtree(folder, ignore_errors=True)
    for target, name, content in seeds():
        (folder / target).mkdir(parents=True, exist_ok=True)
        (folder / target / name).write_bytes(content)


if __name__ == "__main__":
    main()
