#include "cellmap/codec/plane_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace cellmap {
namespace {

std::array<std::int64_t, 3> to_fixed(const std::array<double, 3>& v) {
  std::array<std::int64_t, 3> fixed;
  for (int i = 0; i < 3; ++i) {
    fixed[i] = floor_of(v[i] * (1 << kDirectionBits) + 0.5);
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

/// The neighbours of a patch that count, by coordinate. Not initialised: the first `count` are set.
struct Seen {
  std::int64_t w[6], s1[6], s2[6];
};

/// The one at place floor(count / 2) of the inverse ranges in ascending order.
std::int64_t median_of(const Seen& seen, std::size_t count) {
  std::int64_t w[6];
  for (std::size_t n = 0; n < 6; ++n) w[n] = n < count ? seen.w[n] : kMaxInverseRange;
  const auto order = [&](int a, int b) {
    const std::int64_t low = std::min(w[a], w[b]), high = std::max(w[a], w[b]);
    w[a] = low;
    w[b] = high;
  };
  // A sorting network, written out: a loop over its pairs is not unrolled.
  order(0, 5), order(1, 3), order(2, 4);
  order(1, 2), order(3, 4);
  order(0, 3), order(2, 5);
  order(0, 1), order(2, 3), order(4, 5);
  order(1, 2), order(3, 4);
  return w[count / 2];
}

}  // namespace

PatchFrame::PatchFrame(const Eigen::Vector3d& d) : direction(d) {
  const double across = std::sqrt(d.x() * d.x() + d.y() * d.y());
  const std::array<double, 3> t =
      across > 0 ? std::array{-d.y() / across, d.x() / across, 0.0} : std::array{1.0, 0.0, 0.0};
  tangents = {t, {-d.z() * t[1], d.z() * t[0], d.x() * t[1] - d.y() * t[0]}};
  u = to_fixed({d.x(), d.y(), d.z()});
  t1 = to_fixed(tangents[0]);
  t2 = to_fixed(tangents[1]);
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

KnownPlanes::KnownPlanes(CodingLattice& lattice, std::size_t planes)
    : lattice_(lattice), slots_(lattice.places), planes_(1) {
  planes_.reserve(planes + 1);
}

void KnownPlanes::move_to(std::size_t sphere, std::uint32_t point) {
  sphere_ = sphere;
  point_ = point;
}

PlanePrediction KnownPlanes::predict(const PatchFrame& frame) {
  Seen seen;
  std::size_t count = 0, known = 0;
  const std::uint32_t* const here = slots_.data() + lattice_.first_place[sphere_] + point_;
  for (const std::int32_t offset : lattice_.belts[sphere_].offsets_at(point_)) {
    const std::uint32_t slot = here[offset];
    if (slot == 0) continue;
    const PatchPlane plane = frame.to_patch(planes_[slot]);
    seen.w[count] = plane.w;
    seen.s1[count] = plane.s1;
    seen.s2[count] = plane.s2;
    count += plane.is_in_range();
    if (++known == kUsed) break;
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
  // Those within a share of the median, nearest the median of their inverse ranges. All of it
  // without branches, which no processor would foresee.
  const std::int64_t median = median_of(seen, count);
  const std::int64_t tolerance = median >> 4;
  std::int64_t agrees[kUsed];  // -1 or 0
  std::int64_t w = 0, s1 = 0, s2 = 0, agreeing = 0;
  for (std::size_t n = 0; n < count; ++n) {
    agrees[n] = -static_cast<std::int64_t>(std::abs(seen.w[n] - median) <= tolerance);
    w += seen.w[n] & agrees[n];
    s1 += seen.s1[n] & agrees[n];
    s2 += seen.s2[n] & agrees[n];
    agreeing -= agrees[n];
  }
  const PatchPlane mean{floor_mean(w, agreeing), floor_mean(s1, agreeing),
                        floor_mean(s2, agreeing)};
  prediction.plane = mean;
  for (std::size_t n = 0; n < count; ++n) {
    prediction.w_spread += std::abs(seen.w[n] - mean.w) & agrees[n];
    prediction.s_spread +=
        (std::abs(seen.s1[n] - mean.s1) + std::abs(seen.s2[n] - mean.s2)) & agrees[n];
  }
  prediction.agreeing = static_cast<int>(agreeing);
  return prediction;
}

void KnownPlanes::add(const InversePlane& m) {
  slots_[lattice_.first_place[sphere_] + point_] = static_cast<std::uint32_t>(planes_.size());
  planes_.push_back(m);
}

}  // namespace cellmap
