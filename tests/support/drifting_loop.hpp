#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "cellmap/geometry/pose.hpp"

namespace cellmap::test {

/// A drive through hilly streets that meets its own start again, as odometry sees it and after the
/// loop is closed: the drift is spread along the drive, and every pose but the first moves.
struct DriftingLoop {
  std::vector<Pose> drifted, corrected;
};

/// `count` poses `step_m` apart. Turns, slopes and odometry errors are drawn from `seed`.
inline DriftingLoop drifting_loop(std::size_t count, double step_m, unsigned seed = 1) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal(0, 1);
  DriftingLoop loop;
  Pose truth = Pose::Identity(), drifted = Pose::Identity();
  double turn_rad = 0, pitch_rad = 0;
  for (std::size_t i = 0; i < count; ++i) {
    loop.corrected.push_back(truth);
    loop.drifted.push_back(drifted);
    // Streets: mostly straight, a corner of a quarter turn now and then; slopes that change slowly.
    turn_rad = rng() % 12 == 0 ? (rng() % 2 ? 1.4 : -1.4) : 0.02 * normal(rng);
    pitch_rad = 0.9 * pitch_rad + 0.005 * normal(rng);
    Tangent motion;
    motion << step_m + 0.3 * normal(rng), 0.1 * normal(rng), 0.05 * normal(rng),
        0.004 * normal(rng), pitch_rad, turn_rad;
    Tangent error;
    for (int k = 0; k < 3; ++k) error[k] = 0.01 * normal(rng);
    for (int k = 3; k < 6; ++k) error[k] = 0.001 * normal(rng);
    truth = truth * exp(motion);
    drifted = drifted * exp(motion) * exp(error);
  }
  return loop;
}

}  // namespace cellmap::test
