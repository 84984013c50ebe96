#include "cellmap/simd/residuals.hpp"

#include <algorithm>
#include <cmath>

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/residuals.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using F = hn::ScalableTag<float>;
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

HWY_INLINE Lanes load(const HessePlane* planes, const Points& points, std::size_t i) {
  const F f;
  Lanes at;
  at.p = {hn::LoadU(f, points.x + i), hn::LoadU(f, points.y + i), hn::LoadU(f, points.z + i)};
  hn::LoadInterleaved4(f, &planes[i].nx, at.normal.x, at.normal.y, at.normal.z, at.offset);
  return at;
}

/// The last points, filled up with points that have no plane.
struct Rest {
  static constexpr std::size_t kMost = hn::MaxLanes(F());
  HWY_ALIGN float x[kMost] = {}, y[kMost] = {}, z[kMost] = {};
  HessePlane planes[kMost];

  Rest(const HessePlane* of, const Points& points, std::size_t begin, std::size_t end) {
    std::fill(planes, planes + kMost, HessePlane{0, 0, 0, HUGE_VALF});
    std::copy(of + begin, of + end, planes);
    std::copy(points.x + begin, points.x + end, x);
    std::copy(points.y + begin, points.y + end, y);
    std::copy(points.z + begin, points.z + end, z);
  }
  Lanes lanes() const { return load(planes, {x, y, z}, 0); }
};

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

void Distances(const HessePlane* planes, const Points& points, std::size_t count, float* distance) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    hn::StoreU(distance_of(load(planes, points, i)), f, distance + i);
  }
  if (i < count) {
    HWY_ALIGN float rest[hn::MaxLanes(f)];
    hn::Store(distance_of(Rest(planes, points, i, count).lanes()), f, rest);
    std::copy(rest, rest + (count - i), distance + i);
  }
}

/// Sums of one call, a lane each.
struct LaneSums {
  VF jj[21], jd[6];
  std::size_t points = 0;
};

template <Weighting kWeighting>
HWY_INLINE void add(const Lanes& at, const Weights& weights, VF given, LaneSums& sums) {
  const F f;
  const VF d = distance_of(at);
  const MF inside = hn::Abs(d) <= hn::Set(f, weights.gate_m);
  sums.points += hn::CountTrue(f, inside);
  VF weight = given;
  if constexpr (kWeighting == Weighting::kCauchy || kWeighting == Weighting::kGemanMcClure) {
    const VF ratio = d * hn::Set(f, weights.inverse_width);
    weight = weight / hn::MulAdd(ratio, ratio, weight);
    if constexpr (kWeighting == Weighting::kGemanMcClure) weight = weight * weight;
  }
  weight = hn::IfThenElseZero(inside, weight);
  const VF bounded = hn::IfThenElseZero(inside, d);

  const Vec3 turn = cross(at.p, at.normal);
  const VF J[6] = {at.normal.x, at.normal.y, at.normal.z, turn.x, turn.y, turn.z};
  std::size_t k = 0;
  for (std::size_t r = 0; r < 6; ++r) {
    const VF weighted = weight * J[r];
    sums.jd[r] = hn::MulAdd(weighted, bounded, sums.jd[r]);
    for (std::size_t c = r; c < 6; ++c, ++k) {
      sums.jj[k] = hn::MulAdd(weighted, J[c], sums.jj[k]);
    }
  }
}

template <Weighting kWeighting>
HWY_INLINE void accumulate_as(const HessePlane* planes, const Points& points, std::size_t count,
                              const Weights& weights, NormalSums& sums) {
  const F f;
  const std::size_t lanes = hn::Lanes(f);
  const VF one = hn::Set(f, 1.0f);
  LaneSums lane_sums;
  for (VF& sum : lane_sums.jj) sum = hn::Zero(f);
  for (VF& sum : lane_sums.jd) sum = hn::Zero(f);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const VF given = kWeighting == Weighting::kGiven ? hn::LoadU(f, weights.given + i) : one;
    add<kWeighting>(load(planes, points, i), weights, given, lane_sums);
  }
  if (i < count) {
    HWY_ALIGN float given[hn::MaxLanes(f)];
    std::fill(given, given + lanes, 1.0f);
    if (kWeighting == Weighting::kGiven) std::copy(weights.given + i, weights.given + count, given);
    add<kWeighting>(Rest(planes, points, i, count).lanes(), weights, hn::Load(f, given), lane_sums);
  }
  const auto total = [&](VF sum) HWY_ATTR {
    return static_cast<double>(hn::GetLane(hn::SumOfLanes(f, sum)));
  };
  for (std::size_t k = 0; k < 21; ++k) sums.jj[k] += total(lane_sums.jj[k]);
  for (std::size_t k = 0; k < 6; ++k) sums.jd[k] += total(lane_sums.jd[k]);
  sums.points += lane_sums.points;
}

void Accumulate(const HessePlane* planes, const Points& points, std::size_t count,
                const Weights& weights, NormalSums& sums) {
  switch (weights.weighting) {
    case Weighting::kOne:
      return accumulate_as<Weighting::kOne>(planes, points, count, weights, sums);
    case Weighting::kCauchy:
      return accumulate_as<Weighting::kCauchy>(planes, points, count, weights, sums);
    case Weighting::kGemanMcClure:
      return accumulate_as<Weighting::kGemanMcClure>(planes, points, count, weights, sums);
    case Weighting::kGiven:
      return accumulate_as<Weighting::kGiven>(planes, points, count, weights, sums);
  }
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(Move);
HWY_EXPORT(Distances);
HWY_EXPORT(Accumulate);

void move(const Motion& motion, const Points& points, std::size_t count,
          const MutablePoints& moved) {
  HWY_DYNAMIC_DISPATCH(Move)(motion, points, count, moved);
}

void distances(const HessePlane* planes, const Points& points, std::size_t count, float* distance) {
  HWY_DYNAMIC_DISPATCH(Distances)(planes, points, count, distance);
}

void accumulate(const HessePlane* planes, const Points& points, std::size_t count,
                const Weights& weights, NormalSums& sums) {
  HWY_DYNAMIC_DISPATCH(Accumulate)(planes, points, count, weights, sums);
}

void NormalSums::add(const NormalSums& other) {
  for (std::size_t k = 0; k < jj.size(); ++k) jj[k] += other.jj[k];
  for (std::size_t k = 0; k < jd.size(); ++k) jd[k] += other.jd[k];
  points += other.points;
}

}  // namespace cellmap::simd
#endif
