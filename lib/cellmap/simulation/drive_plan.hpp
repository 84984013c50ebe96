#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/simulation/ground.hpp"
#include "cellmap/simulation/route.hpp"
#include "cellmap/simulation/simulator.hpp"
#include "cellmap/simulation/town_object.hpp"
#include "cellmap/simulation/traffic.hpp"

namespace cellmap::simulation {

/// Independent parts that one seed feeds.
enum SeedPart : std::uint64_t {
  kGroundSeed = 1,
  kTownSeed,
  kCarSeed,
  kNoiseSeed,
  kDriftSeed,
  kLeanSeed
};

/// Seed of the cars of a day.
inline std::uint64_t traffic_seed_of(const SimulatorOptions& options) {
  return options.traffic_seed != 0 ? options.traffic_seed : options.seed;
}

/// What options say of a drive before a ray is cast: the route, where the sensor is at each scan
/// and what moves there. Not to be moved: its parts refer to one another.
class DrivePlan {
 public:
  explicit DrivePlan(const SimulatorOptions& options);
  DrivePlan(const DrivePlan&) = delete;
  DrivePlan& operator=(const DrivePlan&) = delete;

  /// What stands along the route on this day, parked cars included.
  std::vector<TownObject> objects() const;
  /// The vehicles on the move around the sensor at a scan.
  std::vector<MovingCar> moving_at(std::size_t scan, double range_m) const;

  const SimulatorOptions options;
  const Route route;
  const Centreline line;
  const Ground ground;
  const Traffic traffic;
  std::vector<double> arc_m;  ///< on the line, of each scan of the whole route
  Route truth;                ///< T_world_sensor of each scan of the whole route
};

}  // namespace cellmap::simulation
