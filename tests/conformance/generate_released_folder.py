#!/usr/bin/env python3
"""Writes v1/released-folder/, a map as the paper's released code leaves one (FORMAT.md, "The released code's folder"), and
its JSON twin: what a reader makes of it. Shares nothing with the library. --check compares without writing."""
import json
import math
import struct
import sys
from pathlib import Path

import generate

HERE = Path(__file__).resolve().parent
SIZE = 1000  # of the bands
DIRECTIONS = [direction for direction, _, _ in generate.bands(SIZE)]
GAP = 6.0
# Drives along x; scans 1.4 m apart turn slowly. CELLs begin with scans 0, 5, 10, 15; the last is not written.
SCANS = [(0.1 * i, 1.4 * i, 0.02 * i * i, 0.1, 0.01 * i) for i in range(17)]


def float32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def bases():
    found = [0]
    for i, (_, x, y, z, _) in enumerate(SCANS):
        _, bx, by, bz, _ = SCANS[found[-1]]
        if math.dist((x, y, z), (bx, by, bz)) > GAP:
            found.append(i)
    return found


def plane(direction, k):
    """A wall or the ground, its normal with any sign, as eigenvectors have it."""
    x, y, z = direction
    normal = (0.0, 0.0, 1.0) if z < -0.15 else (0.6, 0.8, 0.0) if k % 2 else (1.0, 0.0, 0.0)
    along = sum(a * b for a, b in zip(normal, direction))
    if abs(along) < 0.05:
        return None
    distance = 1.7 / abs(along) if z < -0.15 else 9.0 / abs(along)
    sign = -1.0 if (k * 7 + int(abs(x) * 10)) % 3 else 1.0
    return distance, tuple(sign * n for n in normal)


def cells():
    """For each CELL (index, distance, normal) as written, and those of them that a CELL may have."""
    for c in range(len(bases()) - 1):
        rows = []
        for k in range(c, len(DIRECTIONS), 11 + c):
            found = plane(DIRECTIONS[k], k)
            if found and found[0] < 100:
                rows.append((k, *found))
        if c == 1:
            rows[3] = (rows[3][0], rows[3][1], (0.0, 0.0, 0.0))  # no plane: the reader leaves it out
            rows[8] = (rows[8][0], -rows[8][1], rows[8][2])
        yield rows


def number(value):
    return f"{float32(value):.8g}"


def pcd(rows, binary):
    head = ("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\n"
            "TYPE F F F F\nCOUNT 1 1 1 1\n" + f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
            f"POINTS {len(rows)}\nDATA {'binary' if binary else 'ascii'}\n").encode()
    if binary:
        return head + b"".join(struct.pack("<4f", *normal, distance) for _, distance, normal in rows)
    return head + "".join(" ".join(map(number, (*normal, distance))) + "\n" for _, distance, normal in rows).encode()


def kept(rows):
    for k, distance, normal in rows:
        if distance <= 0 or normal == (0.0, 0.0, 0.0):
            continue
        along = sum(float32(a) * b for a, b in zip(normal, DIRECTIONS[k]))
        yield k, float32(distance), [float32(-n if along > 0 else n) for n in normal]


def all_files():
    odometry = "".join(f"{t:.6f} {x:.6f} {y:.6f} {z:.6f} 0.000000 0.000000 {math.sin(a / 2):.6f} {math.cos(a / 2):.6f}\n"
                       for t, x, y, z, a in SCANS)
    yield "released-folder/cell_odom.txt", odometry.encode()
    twin = []
    for c, rows in enumerate(cells()):
        yield f"released-folder/cell_{c}.pcd", pcd(rows, binary=c == 2)
        yield f"released-folder/index_{c}.txt", "".join(f"{row[0]} " for row in rows).encode()
        planes = list(kept(rows))
        first, end = bases()[c], bases()[c + 1]
        twin.append({"first_scan": first, "scan_count": end - first, "first_stamp_ns": round(SCANS[first][0] * 1e9),
                     "dropped": len(rows) - len(planes), "t_odom_cell": list(SCANS[first][1:4]), "yaw_rad": SCANS[first][4],
                     "indices": [p[0] for p in planes], "distances": [p[1] for p in planes],
                     "normals": [p[2] for p in planes]})
    rows = ",\n ".join(json.dumps(cell) for cell in twin)
    yield "released-folder.json", f"[{rows}]\n".encode()


def main():
    changed = []
    for name, data in all_files():
        path = HERE / "v1" / name
        if "--check" in sys.argv[1:]:
            if not path.exists() or path.read_bytes() != data:
                changed.append(name)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
    if changed:
        print("these files would change: " + ", ".join(changed))
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
