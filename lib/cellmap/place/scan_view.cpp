#include "cellmap/place/scan_view.hpp"

#include <algorithm>
#include <cmath>

namespace cellmap {
namespace {

constexpr std::uint32_t kPatches = 8'000;

}  // namespace

ScanView::ScanView(const PointCloud& scan)
    : lattice_({LatticeKind::kFibonacci, kPatches}), scan_(scan), begin_(kPatches + 2, 0) {
  // Sorted by counting; what has no direction comes last.
  std::vector<std::uint32_t> patch = patches_of(scan);
  for (std::uint32_t& i : patch) i = std::min(i, kPatches);
  for (const std::uint32_t i : patch) ++begin_[i + 1];
  for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
  std::vector<std::uint32_t> next = begin_;
  sorted_.resize(scan.size());
  for (std::size_t i = 0; i < scan.size(); ++i) {
    sorted_[next[patch[i]]++] = {scan[i], scan[i].norm()};
  }
}

std::vector<std::uint32_t> ScanView::patches_of(const PointCloud& points) const {
  std::vector<std::uint32_t> patches(points.size());
  lattice_.nearest(points, patches);
  return patches;
}

PlaneSeen::PlaneSeen(std::span<const ScanView::Point> points, const Eigen::Vector3f& at,
                     const Eigen::Vector3f& normal) {
  constexpr float kTightM = 0.1f, kThroughM = 1.0f;
  const float range = at.norm();
  const float tolerance = std::max(0.5f, 0.05f * range);
  const float through = range + std::max(kThroughM, 0.1f * range);
  for (const ScanView::Point& p : points) {
    const bool agrees = std::abs(p.range_m - range) <= tolerance;
    confirmed |= agrees;
    tight |= agrees && std::abs(normal.dot(p.position - at)) <= kTightM;
    hidden &= p.range_m < range - tolerance;
    seen_through &= p.range_m > through;
  }
}

}  // namespace cellmap
