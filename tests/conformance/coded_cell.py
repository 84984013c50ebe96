"""Coded CELLs from FORMAT.md, "Coded CELL", alone: an encoder without any code of the library.

Python's floats are binary64 and round after each operation; its integers are exact. A compact encoder may choose
any scale that keeps the bound, so this one is simpler than the library's and takes unusual ones on purpose.
"""
import math
import re
import struct
from pathlib import Path

FORMAT = Path(__file__).resolve().parent.parent.parent / "schema" / "FORMAT.md"
UNIT, LIMIT = 2.0**28, 2**30


class Sphere:
    """points[k]: which point of the sphere lattice index first + k is; directions[k] its direction."""

    def __init__(self, size, divisor, offset, first, points, directions):
        self.size, self.divisor, self.offset, self.first = size, divisor, offset, first
        self.points, self.directions = points, directions
        self.radius = 2.0 / math.sqrt(size)
        self.lists = {}

    def nearest_steps(self, reach, limit, multiple, r2):
        steps, f, after = set(), 1, 2
        while f <= limit:
            steps.update(a * f + b * after for a in range(-reach, reach + 1) for b in range(-reach, reach + 1))
            f, after = after, f + after
        ranked = []
        for d in steps:
            if 0 < d <= limit and d % multiple == 0:
                turn = d * 0x9E3779B97F4A7C15 % 2**64
                azimuth = float(turn - 2**64 if turn >= 2**63 else turn) * (2 * math.pi * 2.0**-64)
                height = 2 * d / self.divisor
                ranked.append(((azimuth * azimuth) * r2 + (height * height) / r2, d))
        return [d for _, d in sorted(ranked)[:8]]

    def neighbours(self, p):
        key = (p // 256, p % 4)
        if key not in self.lists:
            m, limit = float(self.divisor), math.floor(16 * math.sqrt(self.size)) + 32
            a = max(1.0, 2.0 * min(256 * (p // 256) + 128, self.size - 1) + self.offset)
            r2 = max(a * (2 * m - a), 1.0) / (m * m)
            if p % 4 == 0:
                offsets = [-d for d in self.nearest_steps(4, limit, 4, r2)]
            else:
                offsets = []
                for d in self.nearest_steps(2, limit // 2, 1, r2):
                    offsets += [-d, d] if (p + d) % 4 == 0 else [-d]
            self.lists[key] = offsets[:8]
        return [p + e for e in self.lists[key]]


# --- Range coding -----------------------------------------------------------------------------------------

class Model:
    def __init__(self, first=128):
        self.f = self.s = 256 * first


class Integer:
    def __init__(self, take):
        self.zero = take()
        self.more = [take() for _ in range(10)]
        self.second = [take() for _ in range(10)]


class Encoder:
    def __init__(self):
        self.value, self.range, self.length = 0, 2**32 - 1, 4

    def grow(self):
        while self.range < 2**24:
            self.value, self.range, self.length = self.value << 8, self.range << 8, self.length + 1

    def bit(self, model, bit):
        bound = (self.range >> 15) * ((model.f + model.s) >> 2)
        if bit:
            self.range = bound
            model.f += (65535 - model.f) >> 4
            model.s += (65535 - model.s) >> 7
        else:
            self.value += bound
            self.range -= bound
            model.f -= model.f >> 4
            model.s -= model.s >> 7
        self.grow()

    def plain(self, count, value):
        while count > 0:
            part = min(count, 16)
            count -= part
            self.range >>= part
            self.value += self.range * (value >> count & (2**part - 1))
            self.grow()

    def integer(self, model, digits, value):
        self.bit(model.zero, value == 0)
        if value == 0:
            return
        self.plain(1, int(value < 0))
        magnitude, r = abs(value), 0
        while r + 1 < digits:
            more = magnitude >> r > 1
            self.bit(model.more[min(r, 9)], more)
            if not more:
                break
            r += 1
        if r > 0:
            self.bit(model.second[min(r, 9)], magnitude >> (r - 1) & 1)
        if r > 1:
            self.plain(r - 1, magnitude & (2**(r - 1) - 1))

    def finish(self):
        return self.value.to_bytes(self.length, "big")


# --- Predicted planes -------------------------------------------------------------------------------------

def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class Frame:
    def __init__(self, u):
        h = math.sqrt(u[0] * u[0] + u[1] * u[1])
        t1 = (-u[1] / h, u[0] / h, 0.0) if h > 0 else (1.0, 0.0, 0.0)
        t2 = (-u[2] * t1[1], u[2] * t1[0], u[0] * t1[1] - u[1] * t1[0])
        self.u, self.t1, self.t2 = u, t1, t2
        self.fixed = [[math.floor(x * 2**20 + 0.5) for x in axis] for axis in (u, t1, t2)]

    def to_patch(self, m):
        return [dot(m, axis) >> 20 for axis in self.fixed]

    def to_cell(self, patch):
        return [sum(v * axis[i] for v, axis in zip(patch, self.fixed)) >> 20 for i in range(3)]


def is_in_range(patch):
    return patch[0] > 0 and all(-LIMIT < v < LIMIT for v in patch)


class Known:
    """fits: whether a prediction is the plane through the centres of those that agree, not their mean"""

    def __init__(self, fits=False):
        self.planes, self.last, self.fits = {}, None, fits

    def add(self, place, m, u):
        self.planes[place], self.last = (m, u), m

    def predict(self, frame, places, points):
        """(w, s1, s2), that count, that agree, spread of w, spread of the slopes; points: of the whole sphere"""
        seen = [self.planes[place] for place in places if place in self.planes][:6]
        seen = [(patch, m, u) for patch, m, u in ((frame.to_patch(m), m, u) for m, u in seen) if is_in_range(patch)]
        if not seen:
            w = abs(self.last[0]) + abs(self.last[1]) if self.last else 0
            return [min(max(w, 2**21), LIMIT - 1), 0, 0], 0, 0, 0, 0
        median = sorted(patch[0] for patch, _, _ in seen)[len(seen) // 2]
        agree = [row for row in seen if abs(row[0][0] - median) <= median >> 4]
        mean = [sum(column) // len(agree) for column in zip(*(patch for patch, _, _ in agree))]
        if self.fits:
            plane, spread = fit(frame, mean, agree, 2.0 / points)
        else:
            plane, spread = mean, sum(abs(patch[0] - mean[0]) for patch, _, _ in agree)
        slopes = [abs(patch[1] - plane[1]) + abs(patch[2] - plane[2]) for patch, _, _ in agree]
        return plane, len(seen), len(agree), spread, total(slopes)


def total(numbers):
    """From left to right; Python's sum of floats is another one from version 3.12 on."""
    result = 0
    for number in numbers:
        result = result + number
    return result


def fit(frame, mean, agree, held):
    """The plane through the centres of those that agree, and twice how far they are from it."""
    at = frame.to_cell(mean)
    x = [u[0] * frame.t1[0] + u[1] * frame.t1[1] for _, _, u in agree]
    y = [dot(u, frame.t2) for _, _, u in agree]
    e = [dot([float(a - b) for a, b in zip(m, at)], u) for _, m, u in agree]
    share = 1 / float(len(agree))

    def covariance(a, b):
        return total(p * q for p, q in zip(a, b)) * share - (total(a) * share) * (total(b) * share)

    xx, yy, xy = covariance(x, x) + held, covariance(y, y) + held, covariance(x, y)
    xe, ye = covariance(x, e), covariance(y, e)
    d = xx * yy - xy * xy
    g1, g2 = (xe * yy - ye * xy) / d, (ye * xx - xe * xy) / d
    dw = (total(e) * share - g1 * (total(x) * share)) - g2 * (total(y) * share)
    if not abs(dw) <= 0.25 * mean[0]:
        dw = g1 = g2 = 0.0
    off = total(abs(q - ((dw + g1 * p) + g2 * r)) for p, r, q in zip(x, y, e))
    return [mean[0] + dw, mean[1] + g1, mean[2] + g2], 2 * off


def float32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


# --- Layers -----------------------------------------------------------------------------------------------

def is_coarse(point):
    return point % 4 == 0


def code_index(coder, block, member, spheres, layer, with_plane, known_to_have):
    """known_to_have: places (sphere, point) of planes that are coded; grows by those of this layer."""
    for number, sphere in enumerate(spheres):
        before = 0
        for begin in range(0, len(sphere.points), 64):
            rows = range(begin, min(begin + 64, len(sphere.points)))
            mine = [k for k in rows if is_coarse(sphere.points[k]) == (layer == 0)]
            coarse = layer == 1 and any(sphere.first + k in with_plane for k in rows if is_coarse(sphere.points[k]))
            any_has = any(sphere.first + k in with_plane for k in mine)
            coder.bit(block[2 * before + coarse], any_has)
            before = any_has
            for k in mine if any_has else ():
                p, c = sphere.points[k], 0
                for q in sphere.neighbours(p):
                    c = 2 * c + ((number, q) in known_to_have)
                coder.bit(member[c], sphere.first + k in with_plane)
                if sphere.first + k in with_plane:
                    known_to_have.add((number, p))


def patches(spheres, layer, planes):
    """(lattice index, sphere's number, sphere, point, frame) of the planes of a layer in order."""
    for number, sphere in enumerate(spheres):
        for k, p in enumerate(sphere.points):
            if sphere.first + k in planes and is_coarse(p) == (layer == 0):
                yield sphere.first + k, number, sphere, p, Frame(sphere.directions[k])


# --- Compact ----------------------------------------------------------------------------------------------

def first_probabilities(version):
    section = FORMAT.read_text().split("### First probabilities")[1].split("###")[0]
    tables = section.split("Version 2:")
    return bytes.fromhex("".join(re.findall(r"^    ([0-9a-f]+)$", tables[version - 1], re.M)))


class CompactModels:
    def __init__(self, take, kinds):
        """kinds: of steps that have models of their own"""
        self.block, self.member = [take() for _ in range(4)], [take() for _ in range(256)]
        self.scale = []
        for _ in range(32):
            zero, negative = take(), take()
            self.scale.append((zero, negative, [[take() for _ in range(8)] for _ in range(2)]))
        self.kinds = kinds
        self.range = [Integer(take) for _ in range(32 * kinds)]
        self.slopes = [[Integer(take) for _ in range(24 * kinds)] for _ in range(2)]


def level(x, q):
    count = 0
    while count < 7 and x >= q:
        q, count = q * 2, count + 1
    return count


class Context:
    def __init__(self, prediction, bound, radius, version):
        (w, s1, s2), count, agree, w_spread, s_spread = prediction
        i = 1 / float(w)
        self.r, self.l1, self.l2 = UNIT * i, float(s1) * i, float(s2) * i
        self.t = math.sqrt((1 + self.l1 * self.l1) + self.l2 * self.l2)
        self.range_share = {1: 0.9, 2: 0.7}[version]
        self.bound, self.radius, self.n, self.out = bound, radius, min(agree, 5), int(count > agree)
        self.row = 8 * (self.n if self.n < 2 else 2 if self.n < 4 else 3)
        self.w_spread, self.s_spread = (float(w_spread) * self.r) * i, float(s_spread) * i

    @staticmethod
    def factor(k):
        return (1.5 if k % 2 else 1.0) * 2.0**(k >> 1)

    def range_step(self, k):
        return ((self.range_share * self.bound) * self.factor(k)) * self.t

    def slope_step(self, k, r):
        return (((1.8 * self.bound / self.radius) * self.factor(k)) * self.t) / r

    def rebuilt(self, k, a, b, c):
        r = self.r + float(a) * self.range_step(k)
        step = self.slope_step(k, r)
        return r, self.l1 + float(b) * step, self.l2 + float(c) * step


def to_plane(frame, leaning):
    r, l1, l2 = leaning
    v = [(u + l1 * a) + l2 * b for u, a, b in zip(frame.u, frame.t1, frame.t2)]
    scale = -1 / math.sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2])
    return tuple(float32(x) for x in (r, v[0] * scale, v[1] * scale, v[2] * scale))


def moves(source, decoded, frame, radius):
    """The farthest that a point on the rim of the patch moves along the source's normal."""
    d, n = source[0], source[1:]
    d2, n2 = decoded[0], decoded[1:]
    worst = 0.0
    for step in range(180):
        phi = step * math.pi / 90
        v = [math.cos(radius) * u + math.sin(radius) * (math.cos(phi) * a + math.sin(phi) * b)
             for u, a, b in zip(frame.u, frame.t1, frame.t2)]
        if dot(n2, v) >= 0:
            return math.inf
        along = dot(n2, frame.u) * d2 / dot(n2, v) - dot(n, frame.u) * d / dot(n, v)
        worst = max(worst, abs(along * dot(n, v)))
    return worst / math.sqrt(dot(n, n))


def choose(context, plane, frame, first_scale):
    n = plane[1:]
    along = dot(n, frame.u)
    slopes = dot(n, frame.t1) / along, dot(n, frame.t2) / along
    for k in range(first_scale, -25, -1):
        a = round((plane[0] - context.r) / context.range_step(k))
        r = context.r + float(a) * context.range_step(k)
        if r <= 0:
            continue
        b, c = [round((l - l0) / context.slope_step(k, r)) for l, l0 in zip(slopes, (context.l1, context.l2))]
        if max(abs(a), abs(b), abs(c)) >= 2**24 - 1:
            break
        if moves(plane, to_plane(frame, context.rebuilt(k, a, b, c)), frame, context.radius) < 0.99 * context.bound:
            return k, a, b, c
    return None


def code_scale(coder, models, k):
    zero, negative, more = models
    coder.bit(zero, k == 0)
    if k == 0:
        return
    coder.bit(negative, k < 0)
    count = 1
    while count < (25 if k < 0 else 12):
        goes_on = abs(k) > count
        coder.bit(more[int(k < 0)][min(count, 8) - 1], goes_on)
        if not goes_on:
            break
        count += 1


def code_compact_plane(coder, models, context, plane, choice):
    def slope_level(step):
        return context.out if context.n < 2 else level(context.s_spread, step * context.n)

    k, a, b, c = choice or (-25, 0, 0, 0)
    code_scale(coder, models.scale[context.row + slope_level(context.slope_step(0, context.r))], k)
    if choice is None:
        for word in struct.unpack("<4I", struct.pack("<4f", *plane)):
            coder.plain(32, word)
        return
    j = min(max(k + 3, 0), 7) if context.n < 2 else level(2 * context.w_spread, context.range_step(k) * context.n)
    kind = 0 if k == 0 or models.kinds == 1 else 1 if k < 0 else 2
    coder.integer(models.range[32 * kind + context.row + j], 24, a)
    j = slope_level(abs(context.slope_step(k, context.r + float(a) * context.range_step(k))))
    coder.integer(models.slopes[0][24 * kind + 8 * min(abs(a), 2) + j], 24, b)
    coder.integer(models.slopes[1][24 * kind + 8 * min(abs(b), 2) + j], 24, c)


def encode_compact(spheres, planes, bound_um, version):
    """planes: lattice index -> (distance, nx, ny, nz). Returns two layers and the decoded planes."""
    table = iter(first_probabilities(version))
    models = [CompactModels(lambda: Model(next(table)), 1 if version == 1 else 3) for _ in range(2)]
    assert next(table, None) is None
    bound = float(bound_um) * 1e-6
    known, have, layers, decoded = Known(fits=version == 2), set(), [], {}
    for layer in range(2):
        coder = Encoder()
        code_index(coder, models[layer].block, models[layer].member, spheres, layer, planes, have)
        for index, number, sphere, p, frame in patches(spheres, layer, planes):
            prediction = known.predict(frame, [(number, q) for q in sphere.neighbours(p)], sphere.size)
            context = Context(prediction, bound, sphere.radius, version)
            choice = choose(context, planes[index], frame, 4 if index % 7 == 0 else 0)
            code_compact_plane(coder, models[layer], context, planes[index], choice)
            decoded[index] = planes[index]
            if choice is None:
                continue
            leaning = context.rebuilt(*choice)
            decoded[index] = to_plane(frame, leaning)
            w = UNIT / leaning[0]
            patch = [w, leaning[1] * w, leaning[2] * w]
            if all(abs(v) < LIMIT for v in patch):
                patch = [math.floor(v + 0.5) for v in patch]
                if is_in_range(patch):
                    known.add((number, p), frame.to_cell(patch), frame.u)
        layers.append(coder.finish())
    return layers, decoded


# --- Packed -----------------------------------------------------------------------------------------------

def place_of_float(value):
    bits = struct.unpack("<I", struct.pack("<f", value))[0]
    return bits ^ 0xFFFFFFFF if bits >> 31 else bits | 0x80000000


def code_float(coder, model, expected, value):
    step = (place_of_float(value) - place_of_float(float32(expected))) % 2**32
    coder.integer(model, 32, step - 2**32 if step >= 2**31 else step)


def encode_packed(spheres, planes):
    known, have, layers = Known(), set(), []
    for layer in range(2):
        coder = Encoder()
        coder.plain(32, 0)  # no zstd frame
        code_index(coder, [Model() for _ in range(4)], [Model() for _ in range(256)], spheres, layer, planes, have)
        distance, last = [[Integer(Model) for _ in range(3)] for _ in range(2)]
        normal = [[Integer(Model) for _ in range(3)] for _ in range(3)]
        for index, number, sphere, p, frame in patches(spheres, layer, planes):
            patch, _, agree, _, _ = known.predict(frame, [(number, q) for q in sphere.neighbours(p)], sphere.size)
            m, e = frame.to_cell(patch), min(agree, 2)
            size = math.sqrt(float(m[0]) * m[0] + float(m[1]) * m[1] + float(m[2]) * m[2])
            expected = [float32(-float(v) / size) for v in m]
            axis = max(range(3), key=lambda i: (abs(m[i]), -i))
            plane = planes[index]
            code_float(coder, distance[e], UNIT / patch[0], plane[0])
            for i in range(3):
                if i != axis:
                    code_float(coder, normal[i][e], expected[i], plane[1 + i])
            a, b = plane[1 + (axis + 1) % 3], plane[1 + (axis + 2) % 3]
            rest = math.sqrt(max(0.0, 1 - a * a - b * b))
            code_float(coder, last[axis], math.copysign(rest, expected[axis]), plane[1 + axis])
            n = plane[1:]
            scale = UNIT / ((n[0] * frame.u[0] + n[1] * frame.u[1] + n[2] * frame.u[2]) * plane[0])
            v = [x * scale for x in n]
            small = all(abs(x) < LIMIT for x in v)
            known.add((number, p), [math.floor(x + 0.5) for x in v] if small else [0, 0, 0], frame.u)
        layers.append(coder.finish())
    return layers, dict(planes)
