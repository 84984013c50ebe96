#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "cellmap/geometry/pose.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap {

/// What stands where on a simulated day: the truth that changes between two days are scored
/// against. The world is that of `simulate` with the same options; all points in the world frame,
/// metres. Distances are to triangles, as the rays meet them (to the ground: its height, exact on
/// level ground). Not thread safe.
class SceneTruth {
 public:
  /// Throws as `simulate` does.
  explicit SceneTruth(const SimulatorOptions& options);
  ~SceneTruth();
  SceneTruth(SceneTruth&&) noexcept;

  /// Distances beyond this are told as this.
  static constexpr double kReach_m = 1.0;

  const Pose& T_world_sensor(std::size_t scan) const;

  /// From each point to the nearest vehicle, parked or moving, at any of `count` scans from
  /// `first`.
  std::vector<double> to_vehicles_m(std::span<const Eigen::Vector3d> points, std::size_t first,
                                    std::size_t count) const;

  /// From a point to the nearest thing that stands there all day: ground, houses, trees, parked
  /// cars; not vehicles on the move.
  double to_standing_m(const Eigen::Vector3d& point) const;

  /// Whether the LiDAR at a pose gets an answer from each point or from behind it: within its field
  /// of view, nothing that stands there all day in between.
  std::vector<bool> in_sight(const Pose& T_world_sensor,
                             std::span<const Eigen::Vector3d> points) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
