#include "cellmap/codec/plane_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace cellmap {
namespace {

std::array<std::int64_t, 3> to_fixed(const Eigen::Vector3d& v) {
  std::array<std::int64_t, 3> fixed;
  for (int i = 0; i < 3; ++i) {
    fixed[i] = static_cast<std::int64_t>(std::floor(v[i] * (1 << kDirectionBits) + 0.5));
  }
  return fixed;
}

std::int64_t dot(const InversePlane& m, const std::array<std::int64_t, 3>& v) {
  return (m.x * v[0] + m.y * v[1] + m.z * v[2]) >> kDirectionBits;
}

/// sum / count, rounded down.
std::int64_t floor_mean(std::int64_t sum, std::int64_t count) {
  return sum >= 0 ? sum / count : -((-sum + count - 1) / count);
}

}  // namespace

PatchFrame::PatchFrame(const Eigen::Vector3d& d) : direction(d) {
  const double across = std::sqrt(d.x() * d.x() + d.y() * d.y());
  const Eigen::Vector3d tangent =
      across > 0 ? Eigen::Vector3d(-d.y() / across, d.x() / across, 0) : Eigen::Vector3d(1, 0, 0);
  u = to_fixed(d);
  t1 = to_fixed(tangent);
  t2 = to_fixed(
      {-d.z() * tangent.y(), d.z() * tangent.x(), d.x() * tangent.y() - d.y() * tangent.x()});
}

PatchPlane PatchFrame::to_patch(const InversePlane& m) const {
  return {dot(m, u), dot(m, t1), dot(m, t2)};
}

InversePlane PatchFrame::to_cell(const PatchPlane& p) const {
  const auto along = [&](int i) {
    return (p.w * u[i] + p.s1 * t1[i] + p.s2 * t2[i]) >> kDirectionBits;
  };
  return {along(0), along(1), along(2)};
}

double magnitude(const PatchPlane& plane) {
  constexpr int kShift = 5;  // so that the sum of squares is exact
  const auto square = [](std::int64_t v) {
    const auto short_v = static_cast<double>(v >> kShift);
    return short_v * short_v;
  };
  return std::floor(std::sqrt(square(plane.w) + square(plane.s1) + square(plane.s2))) *
         (1 << kShift);
}

KnownPlanes::KnownPlanes(const std::vector<LatticeSphere>& spheres, std::size_t planes)
    : spheres_(spheres), planes_(1) {
  planes_.reserve(planes + 1);
  for (const LatticeSphere& sphere : spheres) belts_.emplace_back(sphere);
  slots_.assign(belts_[0].largest_step() + spheres_[0].size, 0);
}

void KnownPlanes::move_to(std::uint32_t lattice_index) {
  while (lattice_index >= spheres_[sphere_].first + spheres_[sphere_].count) {
    ++sphere_;
    slots_.assign(belts_[sphere_].largest_step() + spheres_[sphere_].size, 0);
  }
  point_ = spheres_[sphere_].point(lattice_index - spheres_[sphere_].first);
}

PlanePrediction KnownPlanes::predict(const PatchFrame& frame) {
  std::array<PatchPlane, kUsed> seen;
  std::size_t count = 0;
  const LatticeBelts::Steps& steps = belts_[sphere_].steps_at(point_);
  const std::size_t at = belts_[sphere_].largest_step() + point_;
  for (std::size_t n = 0; n < kUsed; ++n) {
    const std::uint32_t slot = slots_[at - steps[n]];
    if (slot == 0) continue;
    const PatchPlane plane = frame.to_patch(planes_[slot]);
    if (plane.is_in_range()) seen[count++] = plane;
  }
  PlanePrediction prediction;
  prediction.neighbours = static_cast<int>(count);
  if (count == 0) {
    // The last plane's range, seen head on.
    const std::int64_t w =
        planes_.size() > 1 ? std::abs(planes_.back().x) + std::abs(planes_.back().y) : 0;
    prediction.plane = {std::clamp<std::int64_t>(w, kMaxInverseRange >> 9, kMaxInverseRange - 1), 0,
                        0};
    return prediction;
  }
  // Those within a share of the median, nearest the median of their inverse ranges.
  std::array<std::int64_t, kUsed> sorted;
  for (std::size_t n = 0; n < count; ++n) sorted[n] = seen[n].w;
  std::sort(sorted.begin(), sorted.begin() + count);
  const std::int64_t median = sorted[count / 2];
  const std::int64_t tolerance = median >> 4;
  PatchPlane sum;
  std::int64_t agreeing = 0;
  for (std::size_t n = 0; n < count; ++n) {
    if (std::abs(seen[n].w - median) > tolerance) continue;
    sum.w += seen[n].w;
    sum.s1 += seen[n].s1;
    sum.s2 += seen[n].s2;
    ++agreeing;
  }
  PatchPlane& mean = prediction.plane;
  mean = {floor_mean(sum.w, agreeing), floor_mean(sum.s1, agreeing), floor_mean(sum.s2, agreeing)};
  for (std::size_t n = 0; n < count; ++n) {
    if (std::abs(seen[n].w - median) > tolerance) continue;
    prediction.w_spread += std::abs(seen[n].w - mean.w);
    prediction.s_spread += std::abs(seen[n].s1 - mean.s1) + std::abs(seen[n].s2 - mean.s2);
  }
  prediction.agreeing = static_cast<int>(agreeing);
  return prediction;
}

void KnownPlanes::add(const InversePlane& m) {
  slots_[belts_[sphere_].largest_step() + point_] = static_cast<std::uint32_t>(planes_.size());
  planes_.push_back(m);
}

}  // namespace cellmap
