#include "cellmap/simd/moments.hpp"

#include <cmath>

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/moments.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, kMomentLanes>;
using VD = hn::Vec<D>;

HWY_INLINE VD load(const float* values) {
  const D d;
  return hn::PromoteTo(d, hn::LoadU(hn::Rebind<float, D>(), values));
}

/// Coordinates of some points.
struct Coordinates {
  VD x, y, z;

  HWY_INLINE Coordinates(const PatchView& points, std::size_t i)
      : x(load(points.x + i)), y(load(points.y + i)), z(load(points.z + i)) {}

  HWY_INLINE VD squared_range() const {
    return hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z));
  }
};

struct Extremes {
  VD least, most;

  Extremes() : least(hn::Set(D(), HUGE_VAL)), most(hn::Zero(D())) {}
  HWY_INLINE void add(VD value) {
    least = hn::Min(least, value);
    most = hn::Max(most, value);
  }
  HWY_INLINE SquaredRanges of_lanes() const {
    const D d;
    return {hn::GetLane(hn::MinOfLanes(d, least)), hn::GetLane(hn::MaxOfLanes(d, most))};
  }
};

void RangesOf(const PatchView& points, double* ranges) {
  const D d;
  for (std::size_t i = 0; i < padded(points.count); i += hn::Lanes(d)) {
    hn::StoreU(hn::Sqrt(Coordinates(points, i).squared_range()), d, ranges + i);
  }
}

/// The sums of kMomentLanes / Lanes(D) neighbouring lanes.
struct LaneMoments {
  VD count, x, y, z, xx, xy, xz, yy, yz, zz;

  LaneMoments() { count = x = y = z = xx = xy = xz = yy = yz = zz = hn::Zero(D()); }

  /// `counted` is `p`, or zero in lanes that do not count.
  HWY_INLINE void add(const Coordinates& p, const Coordinates& counted) {
    x = hn::Add(x, counted.x);
    y = hn::Add(y, counted.y);
    z = hn::Add(z, counted.z);
    xx = hn::Add(xx, hn::Mul(counted.x, p.x));
    xy = hn::Add(xy, hn::Mul(counted.x, p.y));
    xz = hn::Add(xz, hn::Mul(counted.x, p.z));
    yy = hn::Add(yy, hn::Mul(counted.y, p.y));
    yz = hn::Add(yz, hn::Mul(counted.y, p.z));
    zz = hn::Add(zz, hn::Mul(counted.z, p.z));
  }
};

/// Calls `add(i, sums)` for every vector of each group of lanes and adds the lanes up.
template <typename Add>
HWY_INLINE Moments sum_up(std::size_t count, const Add& add) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  HWY_ALIGN double sums[10][kMomentLanes];
  for (std::size_t group = 0; group < kMomentLanes; group += lanes) {
    LaneMoments m;
    for (std::size_t i = group; i < padded(count); i += kMomentLanes) add(i, m);
    const VD values[10] = {m.count, m.x, m.y, m.z, m.xx, m.xy, m.xz, m.yy, m.yz, m.zz};
    for (std::size_t k = 0; k < 10; ++k) hn::StoreU(values[k], d, sums[k] + group);
  }
  const auto total = [&](std::size_t k) {
    return (sums[k][0] + sums[k][2]) + (sums[k][1] + sums[k][3]);
  };
  Moments moments;
  moments.count = total(0);
  for (std::size_t k = 0; k < 3; ++k) moments.sum[k] = total(1 + k);
  for (std::size_t k = 0; k < 6; ++k) moments.products[k] = total(4 + k);
  return moments;
}

/// The origin in every lane.
struct Origin {
  VD x, y, z;

  explicit Origin(const PatchView& points)
      : x(hn::Set(D(), points.origin[0])),
        y(hn::Set(D(), points.origin[1])),
        z(hn::Set(D(), points.origin[2])) {}

  HWY_INLINE void centre(Coordinates& at) const {
    at.x = hn::Sub(at.x, x);
    at.y = hn::Sub(at.y, y);
    at.z = hn::Sub(at.z, z);
  }
};

Moments MomentsOf(const PatchView& points) {
  const Origin origin(points);
  Moments moments = sum_up(points.count, [&](std::size_t i, LaneMoments& sums) HWY_ATTR {
    Coordinates at(points, i);
    origin.centre(at);
    sums.add(at, at);
  });
  moments.count = static_cast<double>(points.count);
  return moments;
}

MomentsAndRanges MomentsAndRangesOf(const PatchView& points) {
  const Origin origin(points);
  Extremes extremes;
  Moments moments = sum_up(points.count, [&](std::size_t i, LaneMoments& sums) HWY_ATTR {
    Coordinates at(points, i);
    extremes.add(at.squared_range());
    origin.centre(at);
    sums.add(at, at);
  });
  moments.count = static_cast<double>(points.count);
  return {moments, extremes.of_lanes()};
}

Moments MomentsOffPlane(const PatchView& points, const std::array<double, 3>& normal, double offset,
                        double limit) {
  const D d;
  const Origin origin(points);
  const VD nx = hn::Set(d, normal[0]), ny = hn::Set(d, normal[1]), nz = hn::Set(d, normal[2]);
  const VD offsets = hn::Set(d, offset), limits = hn::Set(d, limit), one = hn::Set(d, 1.0);
  Moments moments = sum_up(points.count, [&](std::size_t i, LaneMoments& sums) HWY_ATTR {
    Coordinates at(points, i);
    origin.centre(at);
    const VD projected = hn::Add(hn::Add(hn::Mul(nx, at.x), hn::Mul(ny, at.y)), hn::Mul(nz, at.z));
    const VD distance = hn::Sub(projected, offsets);
    const auto off = hn::Gt(hn::Abs(distance), limits);
    sums.count = hn::Add(sums.count, hn::IfThenElseZero(off, one));
    Coordinates kept = at;
    kept.x = hn::IfThenElseZero(off, at.x);
    kept.y = hn::IfThenElseZero(off, at.y);
    kept.z = hn::IfThenElseZero(off, at.z);
    sums.add(at, kept);
  });
  // The origins after the last point have added nothing but to the count.
  const std::size_t extra = padded(points.count) - points.count;
  if (std::abs(0.0 - offset) > limit) moments.count -= static_cast<double>(extra);
  return moments;
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(RangesOf);
HWY_EXPORT(MomentsOf);
HWY_EXPORT(MomentsAndRangesOf);
HWY_EXPORT(MomentsOffPlane);

void ranges(const PatchView& points, double* ranges_m) {
  HWY_DYNAMIC_DISPATCH(RangesOf)(points, ranges_m);
}

Moments moments(const PatchView& points) { return HWY_DYNAMIC_DISPATCH(MomentsOf)(points); }

MomentsAndRanges moments_and_ranges(const PatchView& points) {
  return HWY_DYNAMIC_DISPATCH(MomentsAndRangesOf)(points);
}

Moments moments_off_plane(const PatchView& points, const std::array<double, 3>& normal,
                          double offset, double limit) {
  return HWY_DYNAMIC_DISPATCH(MomentsOffPlane)(points, normal, offset, limit);
}

}  // namespace cellmap::simd
#endif
