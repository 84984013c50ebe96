"""Planes within a bound (FORMAT.md, "Compact planes")."""

import math
import struct

import numpy as np
from numpy.typing import NDArray

from .errors import corrupt
from .lattice import Lattice
from .prediction import LIMIT, UNIT, KnownPlanes, Prediction, frames_of, is_in_range, neighbour_offsets, to_cell
from .range_decoder import INTEGER_MODELS, RangeDecoder

SCALES = 4 + 256
SCALE_MODELS = 2 + 8 + 8
RANGES = SCALES + 32 * SCALE_MODELS
#: Kinds of steps that have models of their own, by version.
KINDS = {1: 1, 2: 3}
#: Nominal, of the bound, by version.
RANGE_STEP = {1: 0.9, 2: 0.7}
ESCAPE = -25
Patch = tuple[int, int, int]


def _level(x: float, q: float) -> int:
    count = 0
    while count < 7 and x >= q:
        q, count = q * 2, count + 1
    return count


def _factor(k: int) -> float:
    return (1.5 if k % 2 else 1.0) * 2.0**(k >> 1)


def _read_scale(decoder: RangeDecoder, models: int) -> int:
    if decoder.bit(models):
        return 0
    negative, count = decoder.bit(models + 1), 1
    while count < (25 if negative else 12) and decoder.bit(models + 2 + 8 * negative + min(count, 8) - 1):
        count += 1
    return -count if negative else count


def _read_leaning(decoder: RangeDecoder, prediction: Prediction, bound: float, radius: float,
                  version: int) -> tuple[float, float, float] | None:
    """Range and slopes of a plane; None where it follows as it is."""
    (w, s1, s2), count, agree, w_spread, slope_spread, _ = prediction
    i = 1 / float(w)
    r, l1, l2 = UNIT * i, float(s1) * i, float(s2) * i
    t = math.sqrt((1 + l1 * l1) + l2 * l2)
    n, out = min(agree, 5), int(count > agree)
    row = 8 * (n if n < 2 else 2 if n < 4 else 3)
    slope_disagreement = float(slope_spread) * i

    def slope_step(k: int, at: float) -> float:
        return (((1.8 * bound / radius) * _factor(k)) * t) / at

    def slope_level(step: float) -> int:
        return out if n < 2 else _level(slope_disagreement, step * n)

    k = _read_scale(decoder, SCALES + SCALE_MODELS * (row + slope_level(slope_step(0, r))))
    if k == ESCAPE:
        return None
    range_step = ((RANGE_STEP[version] * bound) * _factor(k)) * t
    j = min(max(k + 3, 0), 7) if n < 2 else _level(2 * ((float(w_spread) * r) * i), range_step * n)
    kinds = KINDS[version]
    kind = 0 if k == 0 or kinds == 1 else 1 if k < 0 else 2
    a = decoder.integer(RANGES + INTEGER_MODELS * (32 * kind + row + j), 24)
    r = r + float(a) * range_step
    if not 0 < r <= 10_000:
        raise corrupt(f"A plane of the coded CELL lies at {r} m.")
    step = slope_step(k, r)
    j = slope_level(abs(step))
    slopes = RANGES + INTEGER_MODELS * (32 * kinds + 24 * kind + j)
    b = decoder.integer(slopes + INTEGER_MODELS * 8 * min(abs(a), 2), 24)
    c = decoder.integer(slopes + INTEGER_MODELS * (24 * kinds + 8 * min(abs(b), 2)), 24)
    l1, l2 = l1 + float(b) * step, l2 + float(c) * step
    if not (math.isfinite(l1) and math.isfinite(l2)):
        raise corrupt("A plane of the coded CELL leans beyond all bounds.")
    return r, l1, l2


def read_compact_planes(decoder: RangeDecoder, lattice: Lattice, patches: list[Patch], bound_um: int,
                        version: int, known: KnownPlanes) -> NDArray[np.float32]:
    """(k, 4) the planes of a layer's patches (lattice index, sphere, point) in order."""
    axes, fixed = frames_of(lattice, np.array([index for index, _, _ in patches], dtype=np.intp))
    bound = float(bound_um) * 1e-6
    offsets = [neighbour_offsets(sphere) for sphere in lattice.spheres]
    radii = [2.0 / math.sqrt(sphere.size) for sphere in lattice.spheres]
    planes = np.empty((len(patches), 4))
    for row, (_, sphere, p) in enumerate(patches):
        prediction = known.predict(sphere, p, offsets[sphere][p >> 8][p & 3], axes[row], fixed[row])
        leaning = _read_leaning(decoder, prediction, bound, radii[sphere], version)
        if leaning is None:
            words = [decoder.plain(32) for _ in range(4)]
            planes[row] = struct.unpack("<4f", struct.pack("<4I", *words))
            continue
        r, l1, l2 = leaning
        u, t1, t2 = axes[row]
        x, y, z = ((u[k] + l1 * t1[k]) + l2 * t2[k] for k in range(3))
        scale = -1 / math.sqrt((x * x + y * y) + z * z)
        planes[row] = r, x * scale, y * scale, z * scale
        w = UNIT / r
        patch = (w, l1 * w, l2 * w)
        if all(abs(v) < LIMIT for v in patch):
            rounded = [math.floor(v + 0.5) for v in patch]
            if is_in_range(rounded):
                known.add(sphere, p, to_cell(rounded, fixed[row]), u)
    return planes.astype(np.float32)
