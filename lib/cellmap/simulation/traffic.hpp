#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/simulation/footprint.hpp"
#include "cellmap/simulation/ground.hpp"
#include "cellmap/simulation/route.hpp"

namespace cellmap::simulation {

/// A vehicle on the move at one moment.
struct MovingCar {
  int model = 0;
  Pose T_world_car = Pose::Identity();  ///< standing on its wheels at z = 0 of its own frame
};

/// Traffic along a route, a function of time alone: one car some way ahead of the sensor's vehicle
/// and one behind in its lane, and oncoming ones every 80 m or so in the lane to the left. Whoever
/// would touch the sensor's own vehicle is left out.
class Traffic {
 public:
  Traffic(const Centreline& line, const Ground& ground, std::uint64_t seed);

  /// The cars within `range_m` of the sensor at `time_s`, when its vehicle is at arc length
  /// `ego_s_m`.
  std::vector<MovingCar> at(double time_s, double ego_s_m, const Pose& T_world_sensor,
                            double range_m) const;

 private:
  struct Oncoming {
    double start_s_m, speed_mps;
    int model;
  };
  Pose pose_on_lane(double s_m, double lateral_m, bool oncoming) const;

  const Centreline& line_;
  const Ground& ground_;
  std::vector<Oncoming> oncoming_;
  double phase_rad_ = 0;
  int leader_model_ = 0, follower_model_ = 0;
};

}  // namespace cellmap::simulation
