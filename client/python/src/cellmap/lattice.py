"""The fixed directions that CELLs are seen along (FORMAT.md, "Lattices"), to the last bit."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .errors import unsupported

FIBONACCI, FIBONACCI_BANDS = 1, 2
NAMES = {FIBONACCI: "fibonacci", FIBONACCI_BANDS: "fibonacci-bands"}
_GOLDEN_TURN = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, eq=False)
class Sphere:
    """A whole Fibonacci sphere of which a lattice takes some points."""

    size: int  #: S, its number of points
    divisor: int  #: M
    offset: int  #: o
    first: int  #: lattice index of the first of its points that the lattice has
    points: NDArray[np.int64] = field(repr=False)  #: (n,) which points those are, ascending


@dataclass(frozen=True)
class Lattice:
    """``kind`` 1 is "fibonacci", 2 "fibonacci-bands". Immutable, so it may be shared by threads."""

    kind: int
    size: int
    directions: NDArray[np.float64] = field(repr=False, compare=False)  #: (n, 3) unit vectors, cell frame
    spheres: tuple[Sphere, ...] = field(repr=False, compare=False)

    @property
    def name(self) -> str:
        return NAMES[self.kind]

    @property
    def count(self) -> int:
        """The number of directions."""
        return len(self.directions)


@lru_cache(maxsize=4)
def lattice_of(kind: int, version: int, size: int) -> Lattice:
    """The lattice that a file names. 0.02 s for 50,000 directions, then kept. Error("unsupported")."""
    limits = {FIBONACCI: 1_000_000, FIBONACCI_BANDS: 500_000}
    if kind not in limits or version != 1 or not 1000 <= size <= limits[kind]:
        raise unsupported(f"There is no lattice of kind {kind}, version {version} and size {size}.")
    return _fibonacci(size) if kind == FIBONACCI else _bands(size)


def _sphere_directions(points: NDArray[np.int64], divisor: int, offset: int) -> tuple[NDArray[np.float64], ...]:
    """(r cos, r sin, z) of points of a sphere: five IEEE operations only, as the format asks."""
    f = points.astype(np.uint64) * _GOLDEN_TURN
    a = 2 * points + offset
    z = (divisor - a) / divisor
    r = np.sqrt((a * (2 * divisor - a)).astype(np.float64)) / divisor
    q = (f + np.uint64(2**61)) >> np.uint64(62)
    x = (f - (q << np.uint64(62))).view(np.int64).astype(np.float64) * (2 * np.pi * 2.0**-64)
    x2 = x * x
    s = np.ones_like(x)
    c = np.ones_like(x)
    for n in range(16, 0, -2):
        s = 1.0 - (x2 / (n * (n + 1))) * s
        c = 1.0 - (x2 / (n * (n - 1))) * c
    s = s * x
    cos = np.choose(q.astype(np.intp), [c, -s, -c, s])
    sin = np.choose(q.astype(np.intp), [s, c, -s, -c])
    return r * cos, r * sin, z


def _fibonacci(size: int) -> Lattice:
    points = np.arange(size, dtype=np.int64)
    directions = np.stack(_sphere_directions(points, size, 1), axis=1)
    directions.flags.writeable = False
    return Lattice(FIBONACCI, size, directions, (Sphere(size, size, 1, 0, points),))


def _bands(size: int) -> Lattice:
    parts, spheres, first = [], [], 0
    for count, low, high in [(size, -0.2, 0.7), (2 * size, -0.6, -0.2), (size // 200, -2.0, -0.6)]:
        x, z, y = _sphere_directions(np.arange(count, dtype=np.int64), count - 1, 0)
        points = np.flatnonzero((low <= z) & (z < high))
        parts.append(np.stack([x[points], y[points], z[points]], axis=1))
        spheres.append(Sphere(count, count - 1, 0, first, points))
        first += len(points)
    directions = np.concatenate(parts)
    directions.flags.writeable = False
    return Lattice(FIBONACCI_BANDS, size, directions, tuple(spheres))
