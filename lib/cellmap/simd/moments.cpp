#include "cellmap/simd/moments.hpp"

#include <algorithm>
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

SquaredRanges Centre(const PatchPoint* points, std::size_t count, double* x, double* y, double* z) {
  const double ox = points[0].x, oy = points[0].y, oz = points[0].z;
  double least = HUGE_VAL, most = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double px = points[i].x, py = points[i].y, pz = points[i].z;
    const double range2 = (px * px + py * py) + pz * pz;
    least = std::min(least, range2);
    most = std::max(most, range2);
    x[i] = px - ox;
    y[i] = py - oy;
    z[i] = pz - oz;
  }
  for (std::size_t i = count; i < padded(count); ++i) x[i] = y[i] = z[i] = 0;
  return {least, most};
}

/// The sums of kMomentLanes / Lanes(D) neighbouring lanes.
struct LaneMoments {
  VD count, x, y, z, xx, xy, xz, yy, yz, zz;

  LaneMoments() { count = x = y = z = xx = xy = xz = yy = yz = zz = hn::Zero(D()); }

  /// (mx, my, mz) is (x, y, z), or zero in lanes that do not count.
  HWY_INLINE void add(VD px, VD py, VD pz, VD mx, VD my, VD mz) {
    x = hn::Add(x, mx);
    y = hn::Add(y, my);
    z = hn::Add(z, mz);
    xx = hn::Add(xx, hn::Mul(mx, px));
    xy = hn::Add(xy, hn::Mul(mx, py));
    xz = hn::Add(xz, hn::Mul(mx, pz));
    yy = hn::Add(yy, hn::Mul(my, py));
    yz = hn::Add(yz, hn::Mul(my, pz));
    zz = hn::Add(zz, hn::Mul(mz, pz));
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

Moments MomentsOf(const CentredPoints& points) {
  const D d;
  Moments moments = sum_up(points.count, [&](std::size_t i, LaneMoments& sums) HWY_ATTR {
    const VD x = hn::LoadU(d, points.x + i), y = hn::LoadU(d, points.y + i),
             z = hn::LoadU(d, points.z + i);
    sums.add(x, y, z, x, y, z);
  });
  moments.count = static_cast<double>(points.count);
  return moments;
}

Moments MomentsOffPlane(const CentredPoints& points, const std::array<double, 3>& normal,
                        double offset, double limit) {
  const D d;
  const VD nx = hn::Set(d, normal[0]), ny = hn::Set(d, normal[1]), nz = hn::Set(d, normal[2]);
  const VD offsets = hn::Set(d, offset), limits = hn::Set(d, limit), one = hn::Set(d, 1.0);
  Moments moments = sum_up(points.count, [&](std::size_t i, LaneMoments& sums) HWY_ATTR {
    const VD x = hn::LoadU(d, points.x + i), y = hn::LoadU(d, points.y + i),
             z = hn::LoadU(d, points.z + i);
    const VD distance =
        hn::Sub(hn::Add(hn::Add(hn::Mul(nx, x), hn::Mul(ny, y)), hn::Mul(nz, z)), offsets);
    const auto off = hn::Gt(hn::Abs(distance), limits);
    sums.count = hn::Add(sums.count, hn::IfThenElseZero(off, one));
    sums.add(x, y, z, hn::IfThenElseZero(off, x), hn::IfThenElseZero(off, y),
             hn::IfThenElseZero(off, z));
  });
  // The zeros after the last point have added nothing but to the count.
  const std::size_t zeros = padded(points.count) - points.count;
  if (std::abs(0.0 - offset) > limit) moments.count -= static_cast<double>(zeros);
  return moments;
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(Centre);
HWY_EXPORT(MomentsOf);
HWY_EXPORT(MomentsOffPlane);

Moments Moments::operator-(const Moments& other) const {
  Moments difference = *this;
  difference.count -= other.count;
  for (std::size_t k = 0; k < 3; ++k) difference.sum[k] -= other.sum[k];
  for (std::size_t k = 0; k < 6; ++k) difference.products[k] -= other.products[k];
  return difference;
}

SquaredRanges centre(const PatchPoint* points, std::size_t count, double* x, double* y, double* z) {
  return HWY_DYNAMIC_DISPATCH(Centre)(points, count, x, y, z);
}

Moments moments(const CentredPoints& points) { return HWY_DYNAMIC_DISPATCH(MomentsOf)(points); }

Moments moments_off_plane(const CentredPoints& points, const std::array<double, 3>& normal,
                          double offset, double limit) {
  return HWY_DYNAMIC_DISPATCH(MomentsOffPlane)(points, normal, offset, limit);
}

}  // namespace cellmap::simd
#endif
