#include "cellmap/simd/residuals.hpp"

#include <algorithm>
#include <cmath>

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/residuals.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using F = hn::ScalableTag<float>;
using U = hn::RebindToUnsigned<F>;
using VF = hn::Vec<F>;
using MF = hn::Mask<F>;

struct Vec3 {
  VF x, y, z;
};

/// Points of one vector and their planes.
struct Lanes {
  Vec3 p, normal;
  VF offset;
};

/// The planes of one vector of points. Four floats a point are read at once and transposed: a fifth
/// of what gathering them one coordinate at a time takes.
HWY_INLINE void load_planes(const HessePlane* planes, const std::uint32_t* place, Lanes& at) {
  const F f;
#if HWY_MAX_BYTES == 16 || HWY_MAX_BYTES == 32 || HWY_MAX_BYTES == 64
  const hn::Full128<float> quarter;
  const auto plane = [&](std::size_t k)
                         HWY_ATTR { return hn::LoadU(quarter, &planes[place[k]].nx); };
#if HWY_MAX_BYTES == 16
  const auto every_fourth = plane;
#else
  const hn::Full256<float> half;
  const auto two = [&](std::size_t k)
                       HWY_ATTR { return hn::Combine(half, plane(k + 4), plane(k)); };
#if HWY_MAX_BYTES == 32
  const auto every_fourth = two;
#else
  const auto every_fourth = [&](std::size_t k)
                                HWY_ATTR { return hn::Combine(f, two(k + 8), two(k)); };
#endif
#endif
  const VF p0 = every_fourth(0), p1 = every_fourth(1), p2 = every_fourth(2), p3 = every_fourth(3);
  const VF xy02 = hn::InterleaveLower(f, p0, p2), xy13 = hn::InterleaveLower(f, p1, p3);
  const VF zo02 = hn::InterleaveUpper(f, p0, p2), zo13 = hn::InterleaveUpper(f, p1, p3);
  at.normal.x = hn::InterleaveLower(f, xy02, xy13);
  at.normal.y = hn::InterleaveUpper(f, xy02, xy13);
  at.normal.z = hn::InterleaveLower(f, zo02, zo13);
  at.offset = hn::InterleaveUpper(f, zo02, zo13);
#else
  HWY_ALIGN HessePlane of_point[hn::MaxLanes(f)];
  for (std::size_t k = 0; k < hn::Lanes(f); ++k) of_point[k] = planes[place[k]];
  hn::LoadInterleaved4(f, &of_point[0].nx, at.normal.x, at.normal.y, at.normal.z, at.offset);
#endif
}

HWY_INLINE Lanes load(const HessePlane* planes, const std::uint32_t* place, const Points& points,
                      std::size_t i) {
  const F f;
  Lanes at;
  at.p = {hn::LoadU(f, points.x + i), hn::LoadU(f, points.y + i), hn::LoadU(f, points.z + i)};
  load_planes(planes, place + i, at);
  return at;
}

/// The last points, filled up with points that have no plane.
struct Rest {
  static constexpr std::size_t kMost = hn::MaxLanes(F());
  HWY_ALIGN float x[kMost] = {}, y[kMost] = {}, z[kMost] = {};
  std::uint32_t place[kMost];

  Rest(const PlaneTable& table, const std::uint32_t* of, const Points& points, std::size_t begin,
       std::size_t end) {
    std::fill(std::copy(of + begin, of + end, place), place + kMost, table.count);
    std::copy(points.x + begin, points.x + end, x);
    std::copy(points.y + begin, points.y + end, y);
    std::copy(points.z + begin, points.z + end, z);
  }
  Lanes lanes(const HessePlane* planes) const { return load(planes, place, {x, y, z}, 0); }
};

void FindPlanes(const PlaneTable& table, const std::uint32_t* index, std::size_t count,
                std::uint32_t* place) {
  const U u;
  const std::size_t lanes = hn::Lanes(u);
  const auto first = hn::Set(u, table.first), none = hn::Set(u, table.count);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    hn::StoreU(hn::Min(hn::Sub(hn::LoadU(u, index + i), first), none), u, place + i);
  }
  for (; i < count; ++i) place[i] = std::min(index[i] - table.first, table.count);
}

/// Not fused: see the header.
HWY_INLINE VF dot(const Vec3& a, const Vec3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}

HWY_INLINE Vec3 cross(const Vec3& a, const Vec3& b) {
  return {hn::MulSub(a.y, b.z, a.z * b.y), hn::MulSub(a.z, b.x, a.x * b.z),
          hn::MulSub(a.x, b.y, a.y * b.x)};
}

HWY_INLINE VF row(const Motion& motion, std::size_t r, const Vec3& p) {
  const F f;
  const Vec3 coefficients = {hn::Set(f, motion.R[3 * r]), hn::Set(f, motion.R[3 * r + 1]),
                             hn::Set(f, motion.R[3 * r + 2])};
  return hn::Add(dot(coefficients, p), hn::Set(f, motion.t[r]));
}

void Move(const Motion& motion, const Points& points, std::size_t count,
          const MutablePoints& moved) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    // Callers go through a scan block by block: the next block arrives while this one is worked on.
    hwy::Prefetch(points.x + i + count);
    hwy::Prefetch(points.y + i + count);
    hwy::Prefetch(points.z + i + count);
    const Vec3 p = {hn::LoadU(f, points.x + i), hn::LoadU(f, points.y + i),
                    hn::LoadU(f, points.z + i)};
    hn::StoreU(row(motion, 0, p), f, moved.x + i);
    hn::StoreU(row(motion, 1, p), f, moved.y + i);
    hn::StoreU(row(motion, 2, p), f, moved.z + i);
  }
  const auto at = [&](std::size_t r, std::size_t k) {
    const float* R = motion.R.data() + 3 * r;
    return ((R[0] * points.x[k] + R[1] * points.y[k]) + R[2] * points.z[k]) + motion.t[r];
  };
  for (; i < count; ++i) {
    const float x = at(0, i), y = at(1, i), z = at(2, i);  // `moved` may be `points`
    moved.x[i] = x, moved.y[i] = y, moved.z[i] = z;
  }
}

HWY_INLINE VF distance_of(const Lanes& at) { return hn::Sub(dot(at.normal, at.p), at.offset); }

void Distances(const PlaneTable& table, const std::uint32_t* place, const Points& points,
               std::size_t count, float* distance) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    hn::StoreU(distance_of(load(table.planes, place, points, i)), f, distance + i);
  }
  if (i < count) {
    HWY_ALIGN float rest[hn::MaxLanes(f)];
    hn::Store(distance_of(Rest(table, place, points, i, count).lanes(table.planes)), f, rest);
    std::copy(rest, rest + (count - i), distance + i);
  }
}

/// The derivatives and the distance of some points, each times the root of its weight; their
/// products are all that is summed.
struct Factors {
  static constexpr std::size_t kMost = 512;  // 14 kilobytes, in the nearest cache
  static constexpr std::size_t kEach = 7;    // six derivatives, then the distance
  HWY_ALIGN float of[kEach][kMost];
  std::size_t points = 0;  // within the gate
};

template <Weighting kWeighting>
HWY_INLINE void put(const Lanes& at, const Weights& weights, VF given, std::size_t i,
                    Factors& factors) {
  const F f;
  const VF d = distance_of(at);
  const MF inside = hn::Abs(d) <= hn::Set(f, weights.gate_m);
  factors.points += hn::CountTrue(f, inside);
  VF root = hn::Set(f, 1.0f);
  if constexpr (kWeighting == Weighting::kCauchy || kWeighting == Weighting::kGemanMcClure) {
    const VF ratio = d * hn::Set(f, weights.inverse_width);
    root = root / hn::MulAdd(ratio, ratio, root);
    if constexpr (kWeighting == Weighting::kCauchy) root = hn::Sqrt(root);
  }
  if constexpr (kWeighting == Weighting::kGiven) root = hn::Sqrt(given);
  // A mask costs less than a product, and one for all less than one each.
  if constexpr (kWeighting != Weighting::kOne) root = hn::IfThenElseZero(inside, root);
  const auto weighted = [&](VF value) HWY_ATTR {
    return kWeighting == Weighting::kOne ? hn::IfThenElseZero(inside, value) : root * value;
  };
  const Vec3 normal = {weighted(at.normal.x), weighted(at.normal.y), weighted(at.normal.z)};
  const Vec3 turn = cross(at.p, normal);
  hn::Store(normal.x, f, factors.of[0] + i);
  hn::Store(normal.y, f, factors.of[1] + i);
  hn::Store(normal.z, f, factors.of[2] + i);
  hn::Store(turn.x, f, factors.of[3] + i);
  hn::Store(turn.y, f, factors.of[4] + i);
  hn::Store(turn.z, f, factors.of[5] + i);
  hn::Store(weighted(hn::IfThenElseZero(inside, d)), f, factors.of[6] + i);
}

/// Position of row r's first product in the upper triangle.
constexpr std::size_t first_of_row(std::size_t r) { return r * (13 - r) / 2; }

/// Adds the products of rows r and 5 - r of the normal equations, nine sums in all: as many as even
/// 16 registers hold beside their factors.
template <std::size_t r>
HWY_INLINE void add_rows(const Factors& factors, std::size_t count, NormalSums& sums) {
  const F f;
  constexpr std::size_t s = 5 - r, kFirst = 7 - r, kSecond = 7 - s;
  VF first[kFirst], second[kSecond];
  for (VF& sum : first) sum = hn::Zero(f);
  for (VF& sum : second) sum = hn::Zero(f);
  for (std::size_t i = 0; i < count; i += hn::Lanes(f)) {
    const VF of_r = hn::Load(f, factors.of[r] + i), of_s = hn::Load(f, factors.of[s] + i);
    for (std::size_t k = 0; k < kFirst; ++k) {
      first[k] = hn::MulAdd(of_r, hn::Load(f, factors.of[r + k] + i), first[k]);
    }
    for (std::size_t k = 0; k < kSecond; ++k) {
      second[k] = hn::MulAdd(of_s, hn::Load(f, factors.of[s + k] + i), second[k]);
    }
  }
  const auto total = [&](VF sum) HWY_ATTR {
    return static_cast<double>(hn::GetLane(hn::SumOfLanes(f, sum)));
  };
  for (std::size_t k = 0; k + 1 < kFirst; ++k) sums.jj[first_of_row(r) + k] += total(first[k]);
  for (std::size_t k = 0; k + 1 < kSecond; ++k) sums.jj[first_of_row(s) + k] += total(second[k]);
  sums.jd[r] += total(first[kFirst - 1]);
  sums.jd[s] += total(second[kSecond - 1]);
}

template <Weighting kWeighting>
HWY_INLINE void accumulate_as(const PlaneTable& table, const std::uint32_t* place,
                              const Points& points, std::size_t count, const Weights& weights,
                              NormalSums& sums) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  const VF one = hn::Set(f, 1.0f);
  Factors factors;
  std::size_t filled = 0;
  const auto flush = [&]() HWY_ATTR {
    add_rows<0>(factors, filled, sums);
    add_rows<1>(factors, filled, sums);
    add_rows<2>(factors, filled, sums);
    filled = 0;
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const VF given = kWeighting == Weighting::kGiven ? hn::LoadU(f, weights.given + i) : one;
    put<kWeighting>(load(table.planes, place, points, i), weights, given, filled, factors);
    filled += lanes;
    if (filled == Factors::kMost) flush();
  }
  if (i < count) {
    HWY_ALIGN float given[hn::MaxLanes(f)];
    std::fill(given, given + lanes, 1.0f);
    if (kWeighting == Weighting::kGiven) std::copy(weights.given + i, weights.given + count, given);
    put<kWeighting>(Rest(table, place, points, i, count).lanes(table.planes), weights,
                    hn::Load(f, given), filled, factors);
    filled += lanes;
  }
  if (filled > 0) flush();
  sums.points += factors.points;
}

void Accumulate(const PlaneTable& table, const std::uint32_t* place, const Points& points,
                std::size_t count, const Weights& weights, NormalSums& sums) {
  switch (weights.weighting) {
    case Weighting::kOne:
      return accumulate_as<Weighting::kOne>(table, place, points, count, weights, sums);
    case Weighting::kCauchy:
      return accumulate_as<Weighting::kCauchy>(table, place, points, count, weights, sums);
    case Weighting::kGemanMcClure:
      return accumulate_as<Weighting::kGemanMcClure>(table, place, points, count, weights, sums);
    case Weighting::kGiven:
      return accumulate_as<Weighting::kGiven>(table, place, points, count, weights, sums);
  }
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(Move);
HWY_EXPORT(FindPlanes);
HWY_EXPORT(Distances);
HWY_EXPORT(Accumulate);

void move(const Motion& motion, const Points& points, std::size_t count,
          const MutablePoints& moved) {
  HWY_DYNAMIC_DISPATCH(Move)(motion, points, count, moved);
}

void find_planes(const PlaneTable& table, const std::uint32_t* lattice_index, std::size_t count,
                 std::uint32_t* place) {
  HWY_DYNAMIC_DISPATCH(FindPlanes)(table, lattice_index, count, place);
}

void distances(const PlaneTable& table, const std::uint32_t* place, const Points& points,
               std::size_t count, float* distance) {
  HWY_DYNAMIC_DISPATCH(Distances)(table, place, points, count, distance);
}

void accumulate(const PlaneTable& table, const std::uint32_t* place, const Points& points,
                std::size_t count, const Weights& weights, NormalSums& sums) {
  HWY_DYNAMIC_DISPATCH(Accumulate)(table, place, points, count, weights, sums);
}

void NormalSums::add(const NormalSums& other) {
  for (std::size_t k = 0; k < jj.size(); ++k) jj[k] += other.jj[k];
  for (std::size_t k = 0; k < jd.size(); ++k) jd[k] += other.jd[k];
  points += other.points;
}

}  // namespace cellmap::simd
#endif
