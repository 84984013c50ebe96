#include "cellmap/simulation/simulator.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/geometry/angle.hpp"
#include "cellmap/simulation/drive_plan.hpp"
#include "cellmap/simulation/odometry_model.hpp"
#include "cellmap/simulation/random.hpp"
#include "cellmap/simulation/ray_caster.hpp"
#include "cellmap/simulation/town_tiles.hpp"

namespace cellmap {
namespace {

using namespace simulation;

/// Ray directions in the sensor frame, beam by beam from the top, each beam counter-clockwise from
/// straight ahead.
std::vector<Eigen::Vector3f> ray_directions(const LidarModel& lidar) {
  std::vector<Eigen::Vector3f> directions;
  for (int beam = 0; beam < lidar.beams; ++beam) {
    const double share = lidar.beams > 1 ? static_cast<double>(beam) / (lidar.beams - 1) : 0.0;
    const double elevation =
        kRadPerDeg *
        (lidar.top_elevation_deg + share * (lidar.bottom_elevation_deg - lidar.top_elevation_deg));
    for (int column = 0; column < lidar.columns; ++column) {
      const double azimuth = 2 * std::numbers::pi * column / lidar.columns;
      directions.push_back(Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                                           std::cos(elevation) * std::sin(azimuth),
                                           std::sin(elevation))
                               .cast<float>());
    }
  }
  return directions;
}

/// A real estimate of the same route, moved along the vehicle's own axes as the truth was, so that
/// the error of every relative motion stays what it is.
Route estimate_from_file(const SimulatorOptions& options, const Route& route, const Route& truth) {
  Route estimate = route_from_file(options.odometry, options.route_frame);
  if (estimate.size() != route.size()) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected an estimate with one pose for each of the " +
                    std::to_string(route.size()) + " poses of the route, found " +
                    std::to_string(estimate.size()) + " in " + options.odometry);
  }
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const Pose moved = route[i].pose.inverse() * truth[i].pose;
    estimate[i].stamp = truth[i].stamp;
    estimate[i].pose = estimate[i].pose * moved;
  }
  return estimate;
}

class SimulatedDrive final : public ScanSource {
 public:
  explicit SimulatedDrive(const SimulatorOptions& options)
      : options_(options),
        plan_(options),
        tiles_(caster_, plan_.ground, plan_.objects()),
        directions_(ray_directions(options.lidar)),
        hits_(directions_.size()) {
    Route truth = plan_.truth;
    odometry_ = make_odometry(truth);
    if (options.scans != 0 && options.scans < truth.size()) {
      truth.resize(options.scans);
      odometry_.resize(options.scans);
    }
    truth_ = Trajectory(std::move(truth));
    noise_seed_ = noise_seed();
    for (int model = 0; model < kVehicleModels; ++model) {
      TriangleMesh mesh;
      add_vehicle(model, MeshBuilder(mesh, Pose::Identity()));
      vehicles_.push_back(caster_.build(std::move(mesh)));
    }
  }

  std::size_t size() const override { return truth_.size(); }
  const Trajectory& ground_truth() const override { return truth_; }

  void seek(std::size_t index) override {
    if (index > size()) {
      throw Error(ErrorCode::kInvalidArgument, "expected a scan index of at most " +
                                                   std::to_string(size()) + ", found " +
                                                   std::to_string(index));
    }
    next_ = index;
  }

  std::optional<PosedScan> next() override {
    if (next_ == size()) return std::nullopt;
    const std::size_t index = next_++;
    PosedScan scan;
    scan.index = index;
    scan.stamp = truth_[index].stamp;
    scan.T_odom_sensor = odometry_[index].pose;
    scan.points = sweep(index);
    return scan;
  }

 private:
  Route make_odometry(const Route& truth) const {
    if (options_.odometry == "truth") return truth;
    if (options_.odometry == "drift") {
      return drifted(truth, DriftModel{}, sub_seed(options_.seed, kDriftSeed));
    }
    return estimate_from_file(options_, plan_.route, truth);
  }

  /// Another day or another lane has noise of its own, else a scan would find its noise in the map.
  std::uint64_t noise_seed() const {
    const std::uint64_t day =
        sub_seed(sub_seed(options_.seed, kNoiseSeed), traffic_seed_of(options_));
    return sub_seed(day, std::bit_cast<std::uint64_t>(options_.lateral_offset_m + 0.0));
  }

  PointCloud sweep(std::size_t index) {
    const Pose& T_world_sensor = truth_[index].pose;
    const Eigen::Vector3d p = T_world_sensor.translation();
    const double range_m = options_.lidar.max_range_m;
    std::vector<RayCaster::Instance> scene = tiles_.around(p.x(), p.y(), range_m);
    for (const MovingCar& car : plan_.moving_at(index, range_m)) {
      scene.push_back({vehicles_[static_cast<std::size_t>(car.model)], car.T_world_car});
    }
    caster_.cast(scene, T_world_sensor, directions_, range_m, options_.threads, hits_);
    return measured(index);
  }

  /// What the sensor reports of what the rays hit: some lost, all noisy. Every ray draws from a
  /// seed of its own, so a scan does not depend on those before it.
  PointCloud measured(std::size_t index) const {
    const LidarModel& lidar = options_.lidar;
    const std::uint64_t seed = sub_seed(noise_seed_, index);
    PointCloud points;
    points.reserve(hits_.size());
    for (std::size_t ray = 0; ray < hits_.size(); ++ray) {
      const auto& [range_m, cosine] = hits_[ray];
      if (range_m <= 0) continue;
      if (lidar.grazing_range_m > 0 && range_m > lidar.grazing_range_m * std::sqrt(cosine))
        continue;
      Random random(sub_seed(seed, ray));
      if (random.chance(lidar.drop_out)) continue;
      const double measured_m = range_m + lidar.range_noise_m * random.normal();
      if (measured_m > 0) points.push_back(directions_[ray] * static_cast<float>(measured_m));
    }
    return points;
  }

  SimulatorOptions options_;
  DrivePlan plan_;
  RayCaster caster_;
  TownTiles tiles_;
  std::vector<std::shared_ptr<const RayMesh>> vehicles_;
  std::vector<Eigen::Vector3f> directions_;
  std::vector<RayCaster::Hit> hits_;
  Trajectory truth_;
  Route odometry_;
  std::uint64_t noise_seed_ = 0;
  std::size_t next_ = 0;
};

void require_file(const std::string& path, const std::string& expected) {
  if (!std::filesystem::is_regular_file(path)) {
    throw Error(ErrorCode::kNotFound, "expected " + expected + ", found no such file: " + path);
  }
}

}  // namespace

void SimulatorOptions::validate() const {
  lidar.validate();
  const bool generated = route == "town" || route == "city";
  if (!generated) require_file(route, "the routes \"town\", \"city\" or a trajectory file");
  if (odometry != "truth" && odometry != "drift") {
    require_file(odometry, "the odometry \"truth\", \"drift\" or a trajectory file");
    if (generated || spacing_m > 0) {
      throw Error(ErrorCode::kInvalidArgument,
                  "expected a route file that " + odometry +
                      " was estimated on, row for row, found a generated town or another "
                      "spacing");
    }
  }
  if (!(lateral_offset_m >= -2.0 && lateral_offset_m <= 4.0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a lateral offset of -2 (right) to 4 (left) m, found " +
                    std::to_string(lateral_offset_m));
  }
  if (!(spacing_m >= 0 && spacing_m <= 1000 && std::abs(heading_deg) <= 360 && lean_deg >= 0 &&
        lean_deg <= 30)) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a spacing of 0 to 1000 m, a heading within 360 deg and a lean of 0 to 30 "
                "deg");
  }
  if (threads < 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected 0 (all) or more threads, found " + std::to_string(threads));
  }
}

std::unique_ptr<ScanSource> simulate(const SimulatorOptions& options) {
  options.validate();
  return std::make_unique<SimulatedDrive>(options);
}

}  // namespace cellmap
