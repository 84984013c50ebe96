#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace cellmap::simulation {

/// The ground plan of a thing: a rectangle in the world's xy plane, turned by `yaw_rad`.
struct Footprint {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  double yaw_rad = 0;
  Eigen::Vector2d half_extent = Eigen::Vector2d::Zero();  ///< along its own x and y [m]

  Eigen::Vector2d axis_x() const;
  Eigen::Vector2d axis_y() const;
};

/// True where the two rectangles share a point (separating axes).
bool overlap(const Footprint& a, const Footprint& b);

/// Footprints that are taken, found by place. Insertion and a query cost a few grid cells.
class FootprintIndex {
 public:
  void insert(const Footprint& footprint);
  bool is_free(const Footprint& footprint) const;

 private:
  std::vector<std::uint64_t> cells_of(const Footprint& footprint) const;

  std::vector<Footprint> footprints_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> grid_;
};

}  // namespace cellmap::simulation
