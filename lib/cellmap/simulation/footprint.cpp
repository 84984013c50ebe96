#include "cellmap/simulation/footprint.hpp"

#include <algorithm>
#include <cmath>

namespace cellmap::simulation {
namespace {

constexpr double kFootprintCell_m = 16.0;

std::uint64_t grid_key(std::int32_t x, std::int32_t y) {
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32) |
         static_cast<std::uint32_t>(y);
}

/// Half the length of the shadow that `footprint` throws on `axis`.
double reach_along(const Footprint& footprint, const Eigen::Vector2d& axis) {
  return std::abs(axis.dot(footprint.axis_x())) * footprint.half_extent.x() +
         std::abs(axis.dot(footprint.axis_y())) * footprint.half_extent.y();
}

}  // namespace

Eigen::Vector2d Footprint::axis_x() const { return {std::cos(yaw_rad), std::sin(yaw_rad)}; }
Eigen::Vector2d Footprint::axis_y() const { return {-std::sin(yaw_rad), std::cos(yaw_rad)}; }

bool overlap(const Footprint& a, const Footprint& b) {
  const Eigen::Vector2d between = b.center - a.center;
  for (const Eigen::Vector2d& axis : {a.axis_x(), a.axis_y(), b.axis_x(), b.axis_y()}) {
    if (std::abs(between.dot(axis)) > reach_along(a, axis) + reach_along(b, axis)) return false;
  }
  return true;
}

std::vector<std::uint64_t> FootprintIndex::cells_of(const Footprint& footprint) const {
  const Eigen::Vector2d reach(reach_along(footprint, Eigen::Vector2d::UnitX()),
                              reach_along(footprint, Eigen::Vector2d::UnitY()));
  const Eigen::Vector2d low = (footprint.center - reach) / kFootprintCell_m;
  const Eigen::Vector2d high = (footprint.center + reach) / kFootprintCell_m;
  std::vector<std::uint64_t> cells;
  for (auto x = std::floor(low.x()); x <= high.x(); ++x) {
    for (auto y = std::floor(low.y()); y <= high.y(); ++y) {
      cells.push_back(grid_key(static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)));
    }
  }
  return cells;
}

void FootprintIndex::insert(const Footprint& footprint) {
  const auto index = static_cast<std::uint32_t>(footprints_.size());
  footprints_.push_back(footprint);
  for (const std::uint64_t cell : cells_of(footprint)) grid_[cell].push_back(index);
}

bool FootprintIndex::is_free(const Footprint& footprint) const {
  for (const std::uint64_t cell : cells_of(footprint)) {
    const auto found = grid_.find(cell);
    if (found == grid_.end()) continue;
    const bool taken = std::any_of(found->second.begin(), found->second.end(), [&](auto index) {
      return overlap(footprint, footprints_[index]);
    });
    if (taken) return false;
  }
  return true;
}

}  // namespace cellmap::simulation
