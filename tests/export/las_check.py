#!/usr/bin/env python3
"""Reads a LAS 1.2 file by the specification (ASPRS LAS 1.2, public header block and point format 0), with
nothing of ours, and prints its points as JSON. Exits 1 and says why where the file breaks a rule.
Usage: las_check.py FILE
"""
import json
import struct
import sys


def fail(message):
    print(message)
    sys.exit(1)


def main():
    data = open(sys.argv[1], "rb").read()
    if len(data) < 227 or data[:4] != b"LASF":
        fail("no LAS signature or header cut off")
    version = data[24], data[25]
    if version != (1, 2):
        fail(f"version {version}")
    header_size, offset, records = struct.unpack_from("<HII", data, 94)
    point_format, record_length, count = struct.unpack_from("<BHI", data, 104)
    returns = struct.unpack_from("<5I", data, 111)
    scale = struct.unpack_from("<3d", data, 131)
    shift = struct.unpack_from("<3d", data, 155)
    max_x, min_x, max_y, min_y, max_z, min_z = struct.unpack_from("<6d", data, 179)
    if header_size != 227 or offset != 227 or records != 0:
        fail(f"header of {header_size} bytes, points at {offset}, {records} records")
    if point_format != 0 or record_length != 20:
        fail(f"point format {point_format} of {record_length} bytes")
    if len(data) != offset + 20 * count:
        fail(f"{len(data)} bytes for {count} points")
    if sum(returns) != count:
        fail(f"returns {returns} of {count} points")
    points = []
    for i in range(count):
        x, y, z, _, flags = struct.unpack_from("<iiiHB", data, offset + 20 * i)
        number, of = flags & 7, flags >> 3 & 7
        if not 1 <= number <= of:
            fail(f"point {i} is return {number} of {of}")
        points.append([v * s + o for v, s, o in zip((x, y, z), scale, shift)])
    for axis, (low, high) in enumerate(((min_x, max_x), (min_y, max_y), (min_z, max_z))):
        values = [p[axis] for p in points]
        if values and (abs(min(values) - low) > 1e-9 or abs(max(values) - high) > 1e-9):
            fail(f"bounds of axis {axis}: {low} to {high}, found {min(values)} to {max(values)}")
    print(json.dumps(points))


if __name__ == "__main__":
    main()
