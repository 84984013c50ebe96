#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "cellmap/simulation/route.hpp"

namespace cellmap::simulation {

/// The ground under and beside a route: one height for every place within 160 m of it.
///
/// A recorded route seldom returns to a place at the height it left it with. The heights are first
/// reconciled along the route (springs between neighbours and between passes of the same place, a
/// sparse linear system), then blended over the plane, each point of the route with the slope of
/// its street and a weight that falls with the sixth power of the distance; away from the street a
/// gentle relief is added. Roads that pass over one another become a crossing.
class Ground {
 public:
  /// `sensor_height_m` above ground is where the route's poses lie.
  Ground(const Centreline& line, double sensor_height_m, std::uint64_t seed);

  /// World z at (x, y), or nullopt farther than 160 m from the route. A few hundred route points
  /// are looked at: about a microsecond.
  std::optional<double> height_m(double x, double y) const;

  /// The same for what stands near the route anyway.
  double height_or_zero_m(double x, double y) const { return height_m(x, y).value_or(0.0); }

 private:
  struct Sample {
    double x, y, z;
    double slope_x, slope_y;  // of the street, along itself
  };
  std::unordered_map<std::uint64_t, std::vector<Sample>> grid_;
  std::uint64_t seed_;
};

}  // namespace cellmap::simulation
