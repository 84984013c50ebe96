"""What neighbours on the lattice foretell of a patch (FORMAT.md, "Neighbours" and "Predicted planes")."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice, Sphere

UNIT = 2.0**28
LIMIT = 2**30
Vector = tuple[int, int, int]
Direction = Sequence[float]
Around = tuple[Vector, Vector, Direction]  #: a plane in the patch's frame, in the CELL's, where its own patch is
#: offsets[p // 256][p % 4]: the eight neighbours p + e of point p, nearest first
Offsets = list[list[tuple[int, ...]]]


def reach(sphere: Sphere) -> int:
    """No neighbour's number differs by more."""
    return math.floor(16 * math.sqrt(sphere.size)) + 32


@lru_cache(maxsize=16)
def neighbour_offsets(sphere: Sphere) -> Offsets:
    belts = np.arange((sphere.size + 255) // 256)
    a = np.maximum(1.0, 2.0 * np.minimum(256 * belts + 128, sphere.size - 1) + sphere.offset)
    m = float(sphere.divisor)
    r2 = np.maximum(a * (2 * m - a), 1.0) / (m * m)
    limit = reach(sphere)
    coarse = _nearest_steps(4, limit, 4, sphere, r2)
    fine = _nearest_steps(2, limit // 2, 1, sphere, r2)
    offsets: Offsets = []
    for coarse_steps, fine_steps in zip(coarse.tolist(), fine.tolist()):
        lists = [tuple(-d for d in coarse_steps)]
        for rest in (1, 2, 3):
            both = [e for d in fine_steps for e in ((-d, d) if (rest + d) % 4 == 0 else (-d,))]
            lists.append(tuple(both[:8]))
        offsets.append(lists)
    return offsets


def _nearest_steps(most: int, limit: int, multiple: int, sphere: Sphere,
                   r2: NDArray[np.float64]) -> NDArray[np.int64]:
    """(belts, 8) the eight nearest steps of each belt, nearest first."""
    found: set[int] = set()
    f, after = 1, 2
    while f <= limit:
        found.update(a * f + b * after for a in range(-most, most + 1) for b in range(-most, most + 1))
        f, after = after, f + after
    steps = np.array(sorted(d for d in found if 0 < d <= limit and d % multiple == 0), dtype=np.int64)
    turns = (steps.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)).view(np.int64)
    azimuth = turns.astype(np.float64) * (2 * np.pi * 2.0**-64)
    height = 2 * steps / sphere.divisor
    distance = (azimuth * azimuth)[None, :] * r2[:, None] + (height * height)[None, :] / r2[:, None]
    # Ascending steps and a stable order: the smaller one on a tie.
    nearest: NDArray[np.int64] = steps[np.argsort(distance, axis=1, kind="stable")[:, :8]]
    return nearest


class Frames(NamedTuple):
    """Of k patches: the direction and two tangents, each as floats and as integers of 2^-20."""

    axes: list[list[list[float]]]  #: [k][u, t1, t2][x, y, z]
    fixed: list[list[list[int]]]


def frames_of(lattice: Lattice, indices: NDArray[np.intp]) -> Frames:
    u = lattice.directions[indices]
    h = np.sqrt(u[:, 0] * u[:, 0] + u[:, 1] * u[:, 1])
    divisor = np.where(h > 0, h, 1.0)
    zero = np.zeros_like(h)
    t1 = np.stack([np.where(h > 0, -u[:, 1] / divisor, 1.0), np.where(h > 0, u[:, 0] / divisor, 0.0), zero], axis=1)
    t2 = np.stack([-u[:, 2] * t1[:, 1], u[:, 2] * t1[:, 0], u[:, 0] * t1[:, 1] - u[:, 1] * t1[:, 0]], axis=1)
    axes = np.stack([u, t1, t2], axis=1)
    return Frames(axes.tolist(), np.floor(axes * 2.0**20 + 0.5).astype(np.int64).tolist())


class Prediction(NamedTuple):
    patch: Sequence[float]  #: w, s1, s2
    counting: int
    agree: int
    w_spread: float
    slope_spread: float
    mean: Vector  #: of those that agree, in the patch's frame, whatever is predicted


def is_in_range(patch: Sequence[int]) -> bool:
    return patch[0] > 0 and all(-LIMIT < v < LIMIT for v in patch)


def to_cell(patch: Sequence[int], fixed: list[list[int]]) -> Vector:
    w, s1, s2 = patch
    u, t1, t2 = fixed
    return ((w * u[0] + s1 * t1[0] + s2 * t2[0]) >> 20, (w * u[1] + s1 * t1[1] + s2 * t2[1]) >> 20,
            (w * u[2] + s1 * t1[2] + s2 * t2[2]) >> 20)


def _total(numbers: Iterable[float]) -> float:
    """From left to right; ``sum`` of floats is another one from Python 3.12 on."""
    result = 0.0
    for number in numbers:
        result = result + number
    return result


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _fitted(mean: Vector, agree: list[Around], axes: list[list[float]], fixed: list[list[int]],
            held: float) -> tuple[tuple[float, float, float], float]:
    """The plane through the centres of those that agree, and twice how far they are from it."""
    at, (_, t1, t2) = to_cell(mean, fixed), axes
    x = [u[0] * t1[0] + u[1] * t1[1] for _, _, u in agree]
    y = [_dot(u, t2) for _, _, u in agree]
    e = [_dot((float(m[0] - at[0]), float(m[1] - at[1]), float(m[2] - at[2])), u) for _, m, u in agree]
    share = 1 / float(len(agree))

    def covariance(a: list[float], b: list[float]) -> float:
        return _total(p * q for p, q in zip(a, b)) * share - (_total(a) * share) * (_total(b) * share)

    xx, yy, xy = covariance(x, x) + held, covariance(y, y) + held, covariance(x, y)
    xe, ye = covariance(x, e), covariance(y, e)
    d = xx * yy - xy * xy
    g1, g2 = (xe * yy - ye * xy) / d, (ye * xx - xe * xy) / d
    dw = (_total(e) * share - g1 * (_total(x) * share)) - g2 * (_total(y) * share)
    if not abs(dw) <= 0.25 * mean[0]:
        dw = g1 = g2 = 0.0
    off = _total(abs(q - ((dw + g1 * p) + g2 * r)) for p, r, q in zip(x, y, e))
    return (mean[0] + dw, mean[1] + g1, mean[2] + g2), 2 * off


class KnownPlanes:
    """The planes of both layers that were decoded before, by sphere and point."""

    def __init__(self, lattice: Lattice, *, fits: bool) -> None:
        """``fits``: whether a prediction is the plane through the centres of those that agree, not their mean."""
        self.margins = [reach(sphere) for sphere in lattice.spheres]
        self.sizes = [sphere.size for sphere in lattice.spheres]
        self.planes: list[list[tuple[Vector, Direction] | None]] = [
            [None] * (sphere.size + 2 * margin) for sphere, margin in zip(lattice.spheres, self.margins)]
        self.last: Vector | None = None
        self.fits = fits

    def add(self, sphere: int, point: int, m: Vector, u: Direction) -> None:
        self.planes[sphere][point + self.margins[sphere]] = m, u
        self.last = m

    def predict(self, sphere: int, point: int, offsets: tuple[int, ...], axes: list[list[float]],
                fixed: list[list[int]]) -> Prediction:
        planes, at = self.planes[sphere], point + self.margins[sphere]
        (ux, uy, uz), (ax, ay, az), (bx, by, bz) = fixed
        seen: list[Around] = []
        looked_at = 0
        for offset in offsets:
            known = planes[at + offset]
            if known is None:
                continue
            m, u = known
            x, y, z = m
            w = (x * ux + y * uy + z * uz) >> 20
            s1, s2 = (x * ax + y * ay + z * az) >> 20, (x * bx + y * by + z * bz) >> 20
            if 0 < w < LIMIT and -LIMIT < s1 < LIMIT and -LIMIT < s2 < LIMIT:
                seen.append(((w, s1, s2), m, u))
            looked_at += 1
            if looked_at == 6:
                break
        if not seen:
            w = abs(self.last[0]) + abs(self.last[1]) if self.last else 0
            guess = (min(max(w, 2**21), LIMIT - 1), 0, 0)
            return Prediction(guess, 0, 0, 0, 0, guess)
        median = sorted([patch[0] for patch, _, _ in seen])[len(seen) // 2]
        agree = [around for around in seen if abs(around[0][0] - median) <= median >> 4]
        n = len(agree)
        mean = (sum(p[0] for p, _, _ in agree) // n, sum(p[1] for p, _, _ in agree) // n,
                sum(p[2] for p, _, _ in agree) // n)
        plane: Sequence[float] = mean
        if self.fits:
            plane, spread = _fitted(mean, agree, axes, fixed, 2.0 / self.sizes[sphere])
        else:
            spread = float(sum(abs(p[0] - mean[0]) for p, _, _ in agree))
        slopes = _total(abs(p[1] - plane[1]) + abs(p[2] - plane[2]) for p, _, _ in agree)
        return Prediction(plane, len(seen), n, spread, slopes, mean)
