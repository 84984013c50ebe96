#include "cellmap/simulation/odometry_model.hpp"

#include <cmath>

#include "cellmap/geometry/angle.hpp"
#include "cellmap/simulation/random.hpp"

namespace cellmap::simulation {
namespace {

/// A slowly varying value with the given standard deviation: first-order Gauss-Markov over
/// distance.
class SlowBias {
 public:
  SlowBias(double deviation, double correlation_m, Random& random)
      : deviation_(deviation), correlation_m_(correlation_m), value_(deviation * random.normal()) {}

  double after(double distance_m, Random& random) {
    const double keep = std::exp(-distance_m / correlation_m_);
    value_ = keep * value_ + std::sqrt(1 - keep * keep) * deviation_ * random.normal();
    return value_;
  }

 private:
  double deviation_, correlation_m_, value_;
};

}  // namespace

std::vector<StampedPose> drifted(const std::vector<StampedPose>& truth, const DriftModel& model,
                                 std::uint64_t seed) {
  Random random(seed);
  SlowBias scale(model.scale_bias, model.correlation_m, random);
  SlowBias yaw(model.yaw_bias_deg_per_m * kRadPerDeg, model.correlation_m, random);
  SlowBias pitch(model.pitch_bias_deg_per_m * kRadPerDeg, model.correlation_m, random);
  SlowBias turn_share(model.turn_bias, model.correlation_m, random);
  std::vector<StampedPose> odometry;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (i == 0) {
      odometry.push_back(truth[0]);
      continue;
    }
    const Pose motion = truth[i - 1].pose.inverse() * truth[i].pose;
    const double distance_m = motion.translation().norm(), root = std::sqrt(distance_m);
    const double turn_rad = log(motion)[5];
    const double rotation_noise = model.rotation_noise_deg * kRadPerDeg * root;
    Tangent error;
    error[0] = model.forward_noise_m * root * random.normal() +
               scale.after(distance_m, random) * distance_m;
    error[1] = model.sideways_noise_m * root * random.normal();
    error[2] = model.sideways_noise_m * root * random.normal();
    error[3] = rotation_noise * random.normal();
    error[4] = rotation_noise * random.normal() + pitch.after(distance_m, random) * distance_m;
    error[5] = rotation_noise * random.normal() + yaw.after(distance_m, random) * distance_m +
               turn_share.after(distance_m, random) * turn_rad;
    odometry.push_back({truth[i].stamp, odometry.back().pose * motion * exp(error)});
  }
  return odometry;
}

}  // namespace cellmap::simulation
