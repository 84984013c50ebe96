"""Maps of any size, filled into a store's tables by SQL that both engines understand: CELLs every 6.4 m along a grid of streets
100 m apart, each with its pose, history, drive of 8 scans, small bytes of its own, and a constraint to the next one. Nothing of
it was ever seen by a LiDAR; it is as large and as dense as a city's map is, and its CELLs cannot be decoded."""
import random
import struct

SPACING_M, STREETS_M, GRID_M = 6.44, 100.0, 64.0
BLOB_BYTES = 64


def doubles(*values):
    return struct.pack(f"<{len(values)}d", *values)


ROTATION = doubles(1, 0, 0, 0, 1, 0, 0, 0, 1)
T_FROM_TO = doubles(1, 0, 0, SPACING_M, 0, 1, 0, 0, 0, 0, 1, 0)
INFORMATION = doubles(*(1e4 if i % 7 == 0 else 0 for i in range(36)))
SCORES = struct.pack("<II5d", 90000, 80000, 0.8, 0.9, 0.05, 0.05, 0.02)
SCANS = b"".join(struct.pack("<q", 10**8 * i) + T_FROM_TO for i in range(8))


class Words:
    """Where the engines differ: bytes, and how a number becomes 32 bytes of content hash."""

    def __init__(self, is_sqlite):
        self.is_sqlite = is_sqlite

    def bytes(self, value):
        return f"x'{value.hex()}'" if self.is_sqlite else f"'\\x{value.hex()}'::bytea"

    def hash(self, number):
        return f"CAST(printf('%032d', {number}) AS BLOB)" if self.is_sqlite else f"CAST(lpad(CAST({number} AS TEXT), 32, '0') AS BYTEA)"


def streets(cells):
    """How many CELLs a street has, so that the streets make a square."""
    side_m = (cells * SPACING_M * STREETS_M / 2) ** 0.5
    return max(1, int(side_m / SPACING_M))


def place(cells):
    """SQL of x and y of CELL `i`, counted from 0: first the streets from west to east, then those from south to north."""
    long = streets(cells)
    half = cells // long // 2
    along, street = f"({SPACING_M} * (i % {long}))", f"(i / {long})"
    return (f"CASE WHEN {street} < {half} THEN {along} ELSE {STREETS_M} * ({street} - {half}) END",
            f"CASE WHEN {street} < {half} THEN {STREETS_M} * {street} ELSE {along} END")


def grid(coordinate):
    return f"CAST(FLOOR({coordinate} / {GRID_M}) AS BIGINT)"


def filling(name, cells, is_sqlite):
    """Statements that fill the map of this name, which is there and empty: CELL k comes with revision k."""
    words = Words(is_sqlite)
    x, y = place(cells)
    numbers = f"WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < {cells - 1})"
    key = f"(SELECT id FROM map WHERE name = '{name}')"
    number = f"({key} * 10000000 + i)"
    yield (f"INSERT INTO blob (hash, encoded_bytes, checksum, frame) {numbers} SELECT {words.hash(number)}, {BLOB_BYTES}, "
           f"{words.bytes(bytes(32))}, {words.bytes(bytes(BLOB_BYTES))} FROM n")
    yield f"INSERT INTO session (map, name, aligned) VALUES ({key}, 'drive', 1)"
    yield ("INSERT INTO cell (map, id, hash, session, sequence, planes, encoded_bytes, added, moved, x, y, z, rotation, gx, gy, scans, "
           f"raw_points, voxel_points) {numbers} SELECT {key}, i + 1, {words.hash(number)}, 'drive', i, 5000, {BLOB_BYTES}, i + 1, i + 1, "
           f"{x}, {y}, 0.0, {words.bytes(ROTATION)}, {grid(x)}, {grid(y)}, 8, 900000, 40000 FROM n")
    yield ("INSERT INTO cell_pose (map, cell, revision, x, y, z, rotation) "
           f"SELECT map, id, added, x, y, z, rotation FROM cell WHERE map = {key}")
    yield ("INSERT INTO cell_scans (map, cell, T_odom_cell, scans) "
           f"SELECT map, id, {words.bytes(T_FROM_TO)}, {words.bytes(SCANS)} FROM cell WHERE map = {key}")
    yield ("INSERT INTO pose_constraint (map, id, added, from_cell, to_cell, kind, origin, T_from_to, information, scores) "
           f"SELECT map, id - 1, added, id - 1, id, 2, 1, {words.bytes(T_FROM_TO)}, {words.bytes(INFORMATION)}, {words.bytes(SCORES)} "
           f"FROM cell WHERE map = {key} AND id > 1")
    yield (f"UPDATE map SET revision = {cells}, next_constraint = {cells}, cells = {cells}, planes = {5000 * cells}, "
           f"constraints = {cells - 1}, encoded_bytes = {BLOB_BYTES * cells}, stored_bytes = {BLOB_BYTES * cells}, scans = {8 * cells}, "
           f"raw_points = {900000 * cells}, voxel_points = {40000 * cells}, next_cell = {cells + 1} WHERE name = '{name}'")


def moved_rotation(rng):
    """By some hundredths of a radian about each axis, to first order, as a road leans."""
    a, b, c = (rng.uniform(-0.02, 0.02) for _ in range(3))
    return doubles(*orthonormal([[1, -c, b], [c, 1, -a], [-b, a, 1]]))


def orthonormal(rows):
    """Gram-Schmidt."""
    made = []
    for row in rows:
        for other in made:
            share = sum(p * q for p, q in zip(row, other))
            row = [p - share * q for p, q in zip(row, other)]
        length = sum(p * p for p in row) ** 0.5
        made.append([p / length for p in row])
    return sum(made, [])


def closing_a_loop(name, cells, moved, is_sqlite):
    """Statements of one revision more: the last CELLs move, each in its own way, and a loop ties them to the first ones."""
    words, rng = Words(is_sqlite), random.Random(moved)
    key = f"(SELECT id FROM map WHERE name = '{name}')"
    for cell in range(cells - moved + 1, cells + 1):
        x, y, z = (rng.uniform(-0.5, 0.5) for _ in range(3))
        yield (f"UPDATE cell SET moved = {cells + 1}, x = x + {x}, y = y + {y}, z = z + {z}, "
               f"rotation = {words.bytes(moved_rotation(rng))} WHERE map = {key} AND id = {cell}")
    yield f"UPDATE cell SET gx = {grid('x')}, gy = {grid('y')} WHERE map = {key} AND moved = {cells + 1}"
    yield ("INSERT INTO cell_pose (map, cell, revision, x, y, z, rotation) SELECT map, id, moved, x, y, z, rotation "
           f"FROM cell WHERE map = {key} AND moved = {cells + 1}")
    yield ("INSERT INTO pose_constraint (map, id, added, from_cell, to_cell, kind, origin, T_from_to, information, scores) "
           f"VALUES ({key}, {cells}, {cells + 1}, {cells}, 1, 3, 1, {words.bytes(T_FROM_TO)}, {words.bytes(INFORMATION)}, "
           f"{words.bytes(SCORES)})")
    yield f"UPDATE map SET revision = {cells + 1}, next_constraint = {cells + 1}, constraints = {cells} WHERE name = '{name}'"
