#include "cellmap/simulation/drive_plan.hpp"

#include <cmath>
#include <numbers>

#include "cellmap/geometry/angle.hpp"
#include "cellmap/simulation/random.hpp"
#include "cellmap/simulation/town.hpp"

namespace cellmap::simulation {
namespace {

/// The route moved to its lane and set down on the ground.
Route on_the_ground(const Route& route, const Ground& ground, double left_m, double height_m) {
  Route driven = route;
  for (StampedPose& sample : driven) {
    Eigen::Vector2d left = sample.pose.linear().col(1).head<2>();
    sample.pose.translation().head<2>() += left_m * left.normalized();
    const Eigen::Vector3d p = sample.pose.translation();
    sample.pose.translation().z() = ground.height_or_zero_m(p.x(), p.y()) + height_m;
  }
  return driven;
}

Route whole_route(const SimulatorOptions& options) {
  if (options.route == "town") return town_route(options.lidar.rate_hz);
  if (options.route == "city") return city_route(options.lidar.rate_hz);
  return route_from_file(options.route, options.route_frame);
}

/// Where on the line each pose of the drive lies: both go along it in the same order.
std::vector<double> arcs_of(const Route& drive, const Route& route, const Centreline& line) {
  std::vector<double> arcs;
  std::size_t i = 0;
  for (const StampedPose& pose : drive) {
    while (i + 2 < route.size() && route[i + 1].stamp <= pose.stamp) ++i;
    const double share = static_cast<double>(pose.stamp - route[i].stamp) /
                         static_cast<double>(route[i + 1].stamp - route[i].stamp);
    arcs.push_back(line.arc_of_pose_m(i) +
                   share * (line.arc_of_pose_m(i + 1) - line.arc_of_pose_m(i)));
  }
  return arcs;
}

/// The sensor as it is mounted, for each scan anew where it leans.
void turn_sensor(const SimulatorOptions& options, Route& drive) {
  const std::uint64_t seed = sub_seed(options.seed, kLeanSeed);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    Random random(sub_seed(sub_seed(seed, options.traffic_seed), i));
    const double towards = random.uniform(-std::numbers::pi, std::numbers::pi);
    const Eigen::Vector3d axis(std::cos(towards), std::sin(towards), 0);
    drive[i].pose.rotate(
        Eigen::AngleAxisd(options.heading_deg * kRadPerDeg, Eigen::Vector3d::UnitZ()));
    drive[i].pose.rotate(Eigen::AngleAxisd(random.uniform(0, options.lean_deg) * kRadPerDeg, axis));
  }
}

}  // namespace

DrivePlan::DrivePlan(const SimulatorOptions& given)
    : options(given),
      route(whole_route(given)),
      line(route),
      ground(line, given.lidar.mount_height_m, sub_seed(given.seed, kGroundSeed)),
      traffic(line, ground, sub_seed(traffic_seed_of(given), kCarSeed)) {
  const Route drive = given.spacing_m > 0 ? spaced(route, given.spacing_m) : route;
  arc_m = arcs_of(drive, route, line);
  truth = on_the_ground(drive, ground, given.lateral_offset_m, given.lidar.mount_height_m);
  turn_sensor(given, truth);
}

std::vector<TownObject> DrivePlan::objects() const {
  return plan_town(line, ground, sub_seed(options.seed, kTownSeed), traffic_seed_of(options));
}

std::vector<MovingCar> DrivePlan::moving_at(std::size_t scan, double range_m) const {
  const double time_s = to_seconds(truth[scan].stamp - truth[0].stamp);
  return traffic.at(time_s, arc_m[scan], truth[scan].pose, range_m);
}

}  // namespace cellmap::simulation
