#include "cellmap/simulation/traffic.hpp"

#include <cmath>
#include <numbers>

#include "cellmap/simulation/random.hpp"
#include "cellmap/simulation/town_object.hpp"

namespace cellmap::simulation {
namespace {

constexpr double kOncomingLane_m = 3.5;

double yaw_of(const Pose& T) { return std::atan2(T.linear()(1, 0), T.linear()(0, 0)); }

}  // namespace

Traffic::Traffic(const Centreline& line, const Ground& ground, std::uint64_t seed)
    : line_(line), ground_(ground) {
  Random random(seed);
  phase_rad_ = random.uniform(0, 2 * std::numbers::pi);
  leader_model_ = random.integer(0, kVehicleModels - 1);
  follower_model_ = random.integer(0, kVehicleModels - 1);
  for (double s = random.uniform(0, 80); s < line.length_m(); s += random.uniform(35, 140)) {
    oncoming_.push_back({s, random.uniform(7, 12), random.integer(0, kVehicleModels - 1)});
  }
}

Pose Traffic::pose_on_lane(double s_m, double lateral_m, bool oncoming) const {
  const Centreline::Point street = line_.at(s_m);
  const Eigen::Vector2d p = street.position + lateral_m * street.left();
  const double yaw = street.heading_rad + (oncoming ? std::numbers::pi : 0.0);
  const Eigen::Vector2d ahead(std::cos(yaw), std::sin(yaw));
  const auto ground_at = [&](const Eigen::Vector2d& q) {
    return ground_.height_or_zero_m(q.x(), q.y());
  };
  const double front = ground_at(p + 1.5 * ahead), rear = ground_at(p - 1.5 * ahead);
  Pose T = Pose::Identity();
  T.linear() = (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(-std::atan2(front - rear, 3.0), Eigen::Vector3d::UnitY()))
                   .toRotationMatrix();
  T.translation() << p, 0.5 * (front + rear);
  return T;
}

std::vector<MovingCar> Traffic::at(double time_s, double ego_s_m, const Pose& T_world_sensor,
                                   double range_m) const {
  const Footprint ego = {
      T_world_sensor.translation().head<2>(), yaw_of(T_world_sensor), {2.6, 1.2}};
  std::vector<MovingCar> cars;
  const auto add = [&](double s_m, double lateral_m, bool against, int model) {
    if (s_m < 0 || s_m > line_.length_m()) return;
    const Eigen::Vector2d rough = line_.at(s_m).position - ego.center;
    if (rough.norm() > range_m + 10) return;
    const Pose T = pose_on_lane(s_m, lateral_m, against);
    const Footprint own = {T.translation().head<2>(), yaw_of(T), vehicle_half_extent_m(model)};
    if (!overlap(own, ego)) cars.push_back({model, T});
  };
  const double sway = std::sin(2 * std::numbers::pi * time_s / 50 + phase_rad_);
  add(ego_s_m + 38 + 16 * sway, 0, false, leader_model_);
  add(ego_s_m - 26 + 9 * sway, 0, false, follower_model_);
  for (const Oncoming& car : oncoming_) {
    const double s = std::fmod(car.start_s_m - car.speed_mps * time_s, line_.length_m());
    add(s < 0 ? s + line_.length_m() : s, kOncomingLane_m, true, car.model);
  }
  return cars;
}

}  // namespace cellmap::simulation
