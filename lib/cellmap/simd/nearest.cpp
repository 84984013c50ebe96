#include "cellmap/simd/nearest.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/nearest.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using F = hn::ScalableTag<float>;
using I = hn::RebindToSigned<F>;
using VF = hn::Vec<F>;
using VI = hn::Vec<I>;
using MF = hn::Mask<F>;

constexpr float kRadiansPerTurn = 2.0f * std::numbers::pi_v<float>;

/// The basis of the zone of each lane.
struct Basis {
  VF index_a, index_b, turns_a, turns_b;
};

HWY_INLINE Basis basis_of(const FibonacciZones& zones, std::size_t zone) {
  const F f;
  return {hn::Set(f, zones.index_a[zone]), hn::Set(f, zones.index_b[zone]),
          hn::Set(f, zones.turns_a[zone]), hn::Set(f, zones.turns_b[zone])};
}

HWY_INLINE Basis basis_at(const FibonacciZones& zones, VF r2) {
  const F f;
  Basis basis = basis_of(zones, 0);
  for (std::size_t zone = 1; zone < zones.count; ++zone) {
    const MF beyond = r2 < hn::Set(f, zones.min_r2[zone - 1]);
    if (hn::AllFalse(f, beyond)) break;
    const Basis next = basis_of(zones, zone);
    basis = {hn::IfThenElse(beyond, next.index_a, basis.index_a),
             hn::IfThenElse(beyond, next.index_b, basis.index_b),
             hn::IfThenElse(beyond, next.turns_a, basis.turns_a),
             hn::IfThenElse(beyond, next.turns_b, basis.turns_b)};
  }
  return basis;
}

/// 1 / sqrt(x), off by at most 2e-7 of it: from the processor's estimate where that has 11 bits and
/// one step of Newton's method doubles them.
HWY_INLINE VF inverse_sqrt(VF x) {
  const F f;
#if HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
  const VF y = hn::ApproximateReciprocalSqrt(x);
  return y * hn::NegMulAdd(x * hn::Set(f, 0.5f) * y, y, hn::Set(f, 1.5f));
#else
  return hn::Set(f, 1.0f) / hn::Sqrt(x);
#endif
}

/// 1 / x to 15 bits or better, which is enough for what only bends a chord.
HWY_INLINE VF rough_inverse(VF x) {
  const VF y = hn::ApproximateReciprocal(x);
  return y * hn::NegMulAdd(x, y, hn::Set(F(), 2.0f));
}

/// floor(x) for |x| < 2^21, at whole numbers perhaps one less: a parallelogram's border belongs to
/// both sides.
HWY_INLINE VF floor(VF x) {
#if HWY_TARGET == \
    HWY_SSSE3  // has no instruction for it; adding this drops the digits behind the dot
  const VF whole = hn::Set(F(), 0x1.8p23f);
  return (x - hn::Set(F(), 0.5f)) + whole - whole;
#else
  return hn::Floor(x);
#endif
}

/// Whole numbers in [0, 2^23): added to 2^23 they are the low bits.
HWY_INLINE VI to_integer(VF whole) {
  const I i;
  return hn::BitCast(i, whole + hn::Set(F(), 0x1p23f)) - hn::Set(i, 0x4B00'0000);
}

/// atan2(y, x) in turns. The polynomial is the minimax fit of atan(u) / (2 pi u) in u^2 on [0, 1];
/// it is off by at most 6e-9 turns.
HWY_INLINE VF azimuth_turns(VF x, VF y) {
  const F f;
  const VF ax = hn::Abs(x), ay = hn::Abs(y);
  const VF u = hn::Min(ax, ay) / hn::Max(ax, ay);
  const VF s = u * u;
  VF p = hn::Set(f, -0.000645636525f);
  for (const float c : {0.00348089048f, -0.00890075388f, 0.0153476792f, -0.0221369994f,
                        0.0317461158f, -0.0530461396f, 0.159154838f}) {
    p = hn::MulAdd(p, s, hn::Set(f, c));
  }
  p = p * u;
  p = hn::IfThenElse(ay > ax, hn::Set(f, 0.25f) - p, p);
  p = hn::IfThenElse(x < hn::Zero(f), hn::Set(f, 0.5f) - p, p);
  return hn::CopySignToAbs(p, y);
}

/// 1 - sqrt(1 - e) for |e| < 0.4: a minimax fit, off by at most 2e-6 |e|.
HWY_INLINE VF radius_loss(VF e) {
  const F f;
  VF p = hn::Set(f, 0.0217615527f);
  for (const float c :
       {0.0256318029f, 0.0264757367f, 0.038508854f, 0.0625502976f, 0.1250175186f, 0.4999991474f}) {
    p = hn::MulAdd(p, e, hn::Set(f, c));
  }
  return e * p;
}

struct Direction {
  VF z, r2, inverse_r2;
  VF index;  // as a real number
  VF turns;
};

/// Squared chord to the lattice point that is `dz` higher and `da` further in azimuth.
HWY_INLINE VF squared_chord(const Direction& d, VF twice_z, VF dz, VF da) {
  const F f;
  const VF dz2 = dz * dz;
  const VF e = hn::MulAdd(twice_z, dz, dz2) * d.inverse_r2;  // r'^2 = r^2 (1 - e)
  const VF h = radius_loss(e);
  const VF a2 = da * da;
  // 2 - 2 cos da for |da| < 0.2; the next term is below 5e-6 of it.
  const VF turned = a2 * hn::MulAdd(a2, hn::Set(f, -1.0f / 12), hn::Set(f, 1.0f));
  return hn::MulAdd(d.r2, hn::MulAdd(h, h, hn::NegMulAdd(h, turned, turned)), dz2);
}

/// The corner, as a float that holds its index exactly, and whether it is certain.
struct Corner {
  VF index;
  MF certain;
};

/// Of the corners (0, 0), (1, 0), (0, 1) and (1, 1) of a parallelogram whose (0, 0) is `origin`,
/// the one with the least of c0 to c3, certain where none of the others comes within `guard` of it.
HWY_INLINE Corner least_corner(VF c0, VF c1, VF c2, VF c3, VF origin, const Basis& basis,
                               VF guard) {
  const VF least01 = hn::Min(c0, c1), least23 = hn::Min(c2, c3);
  const VF second = hn::Min(hn::Max(least01, least23), hn::Min(hn::Max(c0, c1), hn::Max(c2, c3)));
  const VF least = hn::Min(least01, least23);
  const MF beyond_b = least23 < least01;
  const MF beyond_a = hn::Or(hn::And(beyond_b, c3 < c2), hn::AndNot(beyond_b, c1 < c0));
  const VF along_a = hn::IfThenElseZero(beyond_a, basis.index_a);
  const VF along_b = hn::IfThenElseZero(beyond_b, basis.index_b);
  return {origin + along_a + along_b, second - least >= guard};
}

/// Real coordinates of a direction in a basis, split into the parallelogram and the place in it.
struct Coordinates {
  VF origin;  // index of the corner (0, 0)
  VF u, v;

  HWY_INLINE Coordinates(const Basis& basis, VF index, VF turns) {
    const VF a = hn::MulSub(basis.turns_b, index, basis.index_b * turns);
    const VF b = hn::NegMulAdd(basis.turns_a, index, basis.index_a * turns);
    const VF floor_a = floor(a), floor_b = floor(b);
    origin = hn::MulAdd(floor_a, basis.index_a, floor_b * basis.index_b);
    u = a - floor_a;
    v = b - floor_b;
  }
};

HWY_INLINE Corner nearest_corner(const FibonacciZones& zones, const Direction& d,
                                 const Basis& basis) {
  const F f;
  const Coordinates at(basis, d.index, d.turns);
  // Steps along a and b in height and radians; from the direction to the corner (0, 0), and on by
  // one step along a, b or both.
  const VF to_height = hn::Set(f, -2.0f / zones.points);
  const VF to_radians = hn::Set(f, kRadiansPerTurn);
  const VF height_a = basis.index_a * to_height, height_b = basis.index_b * to_height;
  const VF azimuth_a = basis.turns_a * to_radians, azimuth_b = basis.turns_b * to_radians;
  const VF dz0 = hn::NegMulSub(height_a, at.u, height_b * at.v);
  const VF da0 = hn::NegMulSub(azimuth_a, at.u, azimuth_b * at.v);
  const VF dz2 = dz0 + height_b, da2 = da0 + azimuth_b;
  const VF twice_z = d.z + d.z;
  Corner corner = least_corner(squared_chord(d, twice_z, dz0, da0),
                               squared_chord(d, twice_z, dz0 + height_a, da0 + azimuth_a),
                               squared_chord(d, twice_z, dz2, da2),
                               squared_chord(d, twice_z, dz2 + height_a, da2 + azimuth_a),
                               at.origin, basis, hn::Set(f, zones.guard));
  corner.certain = hn::And(corner.certain, d.r2 >= hn::Set(f, zones.cap_r2));
  return corner;
}

/// The guard of scaled chords at the equator: the errors of floats (header), which in spacings d
/// are 2e-5 + 1.5e-7 / d, and what the expansion leaves out for lattice points within 0.9 d.
float equator_guard(float points, float least_r2) {
  const float spacing2 = 4 * std::numbers::pi_v<float> / points;
  const float rounding = 7.2f * (2e-5f + 1.5e-7f / std::sqrt(spacing2));
  const float left_out = 1.2f * (1.25f - least_r2) / least_r2 * spacing2;
  return spacing2 * (rounding + left_out);
}

/// The equator's zone, where the sphere bends a patch so little that a few terms tell which corner
/// is nearest.
struct Equator {
  Basis basis;
  VF height_a, height_b, radians_a, radians_b;  // of the steps along a and b
  VF least_r2;                                  // where it begins
  VF guard;

  HWY_INLINE explicit Equator(const FibonacciZones& zones) : basis(basis_of(zones, 0)) {
    const F f;
    height_a = basis.index_a * hn::Set(f, -2.0f / zones.points);
    height_b = basis.index_b * hn::Set(f, -2.0f / zones.points);
    radians_a = basis.turns_a * hn::Set(f, kRadiansPerTurn);
    radians_b = basis.turns_b * hn::Set(f, kRadiansPerTurn);
    const float r2 = std::max(zones.min_r2[0], zones.cap_r2);
    least_r2 = hn::Set(f, r2);
    guard = hn::Set(f, equator_guard(zones.points, r2));
  }
};

/// The corner with the least chord up to terms of third order. With x = dz and y = r^2 da,
///   r^2 chord^2 = x^2 + y^2 + (z / r^2) x (x^2 - y^2) + ...,
/// and what is left out is at most (1 / 4 + z^2) / r^2 of chord^4 (`equator_guard`).
HWY_INLINE Corner nearest_corner_at_equator(const Equator& equator, const Direction& d) {
  const Coordinates at(equator.basis, d.index, d.turns);
  const VF azimuth_a = equator.radians_a * d.r2, azimuth_b = equator.radians_b * d.r2;
  const VF bend = d.z * hn::ApproximateReciprocal(d.r2);
  const auto scaled_chord = [&](VF x, VF y) HWY_ATTR {
    const VF x2 = x * x;
    return hn::MulAdd(bend * x, hn::NegMulAdd(y, y, x2), hn::MulAdd(y, y, x2));
  };
  const VF x0 = hn::NegMulSub(equator.height_a, at.u, equator.height_b * at.v);
  const VF y0 = hn::NegMulSub(azimuth_a, at.u, azimuth_b * at.v);
  const VF x2 = x0 + equator.height_b, y2 = y0 + azimuth_b;
  return least_corner(scaled_chord(x0, y0), scaled_chord(x0 + equator.height_a, y0 + azimuth_a),
                      scaled_chord(x2, y2), scaled_chord(x2 + equator.height_a, y2 + azimuth_a),
                      at.origin, equator.basis, equator.guard);
}

/// As above away from the equator, in whichever hemisphere.
HWY_INLINE Corner nearest_corner_up_or_down(const FibonacciZones& zones, Direction d) {
  const F f;
  const VF one = hn::Set(f, 1.0f);
  const MF south = d.z < hn::Zero(f);
  d.z = hn::Abs(d.z);
  // 1 - |z| = r^2 / (1 + |z|).
  d.index =
      hn::MulSub(hn::Set(f, 0.5f * zones.points), d.r2 / (one + d.z), hn::Set(f, zones.first));
  const VF mirrored = hn::Set(f, zones.last_turns) - d.turns;
  d.turns = hn::IfThenElse(south, mirrored - hn::Round(mirrored), d.turns);
  Corner corner = nearest_corner(zones, d, basis_at(zones, d.r2));
  const VF last = hn::Set(f, zones.points - 2.0f * zones.first);
  corner.index = hn::IfThenElse(south, last - corner.index, corner.index);
  return corner;
}

/// Where the kernel writes.
struct Output {
  std::uint32_t* index;
  std::uint32_t* undecided;
  std::size_t undecided_count = 0;
};

/// Directions of a block on their way from the first loop to the second. Either loop is short
/// enough for the processor to work on several vectors at a time; as one loop, its chain of
/// operations fills the queues and the next vector waits.
struct Block {
  static constexpr std::size_t kMost = 256;
  HWY_ALIGN float z[kMost], r2[kMost], turns[kMost];
};

HWY_INLINE void put_direction(VF x, VF y, VF z, std::size_t at, Block& block) {
  const F f;
  const VF rho2 = hn::MulAdd(x, x, y * y);
  const VF norm2 = hn::MulAdd(z, z, rho2);
  const VF inverse = inverse_sqrt(norm2);
  hn::Store(z * inverse, f, block.z + at);
  hn::Store(rho2 * inverse * inverse, f, block.r2 + at);
  hn::Store(azimuth_turns(x, y), f, block.turns + at);
}

/// One vector of directions, of which the first `count` are wanted, the first one at `position`.
HWY_INLINE void nearest_of(const FibonacciZones& zones, const Equator& equator, const Block& block,
                           std::size_t at, std::size_t position, std::size_t count, Output& out) {
  const F f;
  const I i;
  Direction d{hn::Load(f, block.z + at), hn::Load(f, block.r2 + at), hn::Zero(f), hn::Zero(f),
              hn::Load(f, block.turns + at)};
  Corner corner{hn::Zero(f), hn::FirstN(f, 0)};  // NEON cannot call a default constructor here
  if (HWY_LIKELY(hn::AllTrue(f, d.r2 >= equator.least_r2))) {
    const VF half = hn::Set(f, 0.5f * zones.points);
    d.index = hn::NegMulAdd(half, d.z, hn::Set(f, 0.5f * zones.points - zones.first));
    corner = nearest_corner_at_equator(equator, d);
  } else {
    d.inverse_r2 = rough_inverse(d.r2);
    corner = nearest_corner_up_or_down(zones, d);
  }
  const VI index = to_integer(corner.index);
  HWY_ALIGN std::int32_t found[hn::MaxLanes(i)];
  if (HWY_LIKELY(count == hn::Lanes(f) && hn::AllTrue(f, corner.certain))) {
    // Indices are below 2^20: signed lanes hold the same bits.
    hn::StoreU(index, i, reinterpret_cast<std::int32_t*>(out.index + position));
    return;
  }
  hn::Store(hn::IfThenElse(hn::RebindMask(i, corner.certain), index, hn::Set(i, -1)), i, found);
  for (std::size_t lane = 0; lane < count; ++lane) {
    out.index[position + lane] = static_cast<std::uint32_t>(found[lane]);
    if (found[lane] < 0) {
      out.undecided[out.undecided_count++] = static_cast<std::uint32_t>(position + lane);
    }
  }
}

std::size_t Nearest(const FibonacciZones& zones, const float* x, const float* y, const float* z,
                    std::size_t count, std::uint32_t* index, std::uint32_t* undecided) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  const Equator equator(zones);
  Output out{index, undecided};
  Block block;
  for (std::size_t begin = 0; begin < count; begin += Block::kMost) {
    const std::size_t size = std::min(Block::kMost, count - begin);
    const float *const bx = x + begin, *const by = y + begin, *const bz = z + begin;
    std::size_t i = 0;
    for (; i + lanes <= size; i += lanes) {
      put_direction(hn::LoadU(f, bx + i), hn::LoadU(f, by + i), hn::LoadU(f, bz + i), i, block);
    }
    if (i < size) {
      HWY_ALIGN float rest[3][hn::MaxLanes(f)] = {};
      std::copy(bx + i, bx + size, rest[0]);
      std::copy(by + i, by + size, rest[1]);
      std::copy(bz + i, bz + size, rest[2]);
      put_direction(hn::Load(f, rest[0]), hn::Load(f, rest[1]), hn::Load(f, rest[2]), i, block);
    }
    for (i = 0; i < size; i += lanes) {
      nearest_of(zones, equator, block, i, begin + i, std::min(lanes, size - i), out);
    }
  }
  return out.undecided_count;
}

std::size_t LargestDot(const Directions& directions, std::size_t begin, std::size_t end,
                       const double direction[3], bool last_wins) {
  using D = hn::ScalableTag<double>;
  const D d;
  const auto dx = hn::Set(d, direction[0]), dy = hn::Set(d, direction[1]),
             dz = hn::Set(d, direction[2]);
  const std::size_t lanes = hn::Lanes(d);
  auto largest = hn::Set(d, -HUGE_VAL);
  auto at = hn::Zero(d);  // positions as doubles
  auto position = hn::Add(hn::Iota(d, 0.0), hn::Set(d, static_cast<double>(begin)));
  const auto step = hn::Set(d, static_cast<double>(lanes));
  std::size_t k = begin;
  for (; k + lanes <= end; k += lanes, position = hn::Add(position, step)) {
    const auto x = hn::Mul(hn::LoadU(d, directions.x + k), dx);
    const auto y = hn::Mul(hn::LoadU(d, directions.y + k), dy);
    const auto z = hn::Mul(hn::LoadU(d, directions.z + k), dz);
    const auto dot = hn::Add(hn::Add(x, y), z);
    const auto better = last_wins ? hn::Ge(dot, largest) : hn::Gt(dot, largest);
    largest = hn::IfThenElse(better, dot, largest);
    at = hn::IfThenElse(better, position, at);
  }
  HWY_ALIGN double dots[hn::MaxLanes(d)], positions[hn::MaxLanes(d)];
  hn::Store(largest, d, dots);
  hn::Store(at, d, positions);
  double best = -HUGE_VAL;
  std::size_t found = begin;
  const auto offer = [&](double dot, std::size_t candidate) {
    const bool wins = last_wins ? candidate > found : candidate < found;
    if (dot > best || (dot == best && wins)) best = dot, found = candidate;
  };
  for (; k < end; ++k) {
    offer(directions.x[k] * direction[0] + directions.y[k] * direction[1] +
              directions.z[k] * direction[2],
          k);
  }
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    offer(dots[lane], static_cast<std::size_t>(positions[lane]));
  }
  return found;
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(Nearest);
HWY_EXPORT(LargestDot);

std::size_t nearest(const FibonacciZones& zones, const float* x, const float* y, const float* z,
                    std::size_t count, std::uint32_t* index, std::uint32_t* undecided) {
  return HWY_DYNAMIC_DISPATCH(Nearest)(zones, x, y, z, count, index, undecided);
}

std::size_t largest_dot(const Directions& directions, std::size_t begin, std::size_t end,
                        const double direction[3], bool last_wins) {
  return HWY_DYNAMIC_DISPATCH(LargestDot)(directions, begin, end, direction, last_wins);
}

}  // namespace cellmap::simd
#endif
