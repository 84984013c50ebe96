#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/scan/trajectory.hpp"

namespace cellmap::simulation {

/// How laser odometry errs. Each step's true motion is followed by a small error exp(xi) whose
/// parts are
/// - noise that is independent from step to step; its variance grows with the distance travelled;
/// - a bias that is proportional to the distance and drifts slowly (first-order Gauss-Markov over
///   distance, standard deviation as given, correlation length `correlation_m`);
/// - for yaw, a share of the turn.
/// A vehicle that stands still does not drift. Defaults drift by about 0.5 to 1 % over a kilometre.
struct DriftModel {
  double forward_noise_m = 0.009;     ///< per square root of metre
  double sideways_noise_m = 0.006;    ///< y and z, per square root of metre
  double rotation_noise_deg = 0.015;  ///< each axis, per square root of metre
  double scale_bias = 0.0045;         ///< share of the distance
  double yaw_bias_deg_per_m = 0.0035;
  double pitch_bias_deg_per_m = 0.0018;
  double turn_bias = 0.0045;  ///< share of the turn
  double correlation_m = 120;
};

/// What odometry makes of a true drive: same stamps, first pose kept. Deterministic in `seed`.
std::vector<StampedPose> drifted(const std::vector<StampedPose>& truth, const DriftModel& model,
                                 std::uint64_t seed);

}  // namespace cellmap::simulation
