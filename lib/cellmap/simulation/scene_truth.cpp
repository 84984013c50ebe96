#include "cellmap/simulation/scene_truth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "cellmap/geometry/angle.hpp"
#include "cellmap/simulation/drive_plan.hpp"
#include "cellmap/simulation/ray_caster.hpp"
#include "cellmap/simulation/town_tiles.hpp"

namespace cellmap {
namespace {

using namespace simulation;
using Point = Eigen::Vector3d;

double to_segment_m(const Point& p, const Point& a, const Point& b) {
  const Point along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0.0;
  return (p - (a + t * along)).norm();
}

/// To the plane where the foot of the perpendicular lies inside, else to the nearest side.
double to_triangle_m(const Point& p, const std::array<Point, 3>& corners) {
  const auto& [a, b, c] = corners;
  const Point normal = (b - a).cross(c - a);
  if (normal.squaredNorm() > 0) {
    const auto inside = [&](const Point& u, const Point& v) {
      return (v - u).cross(p - u).dot(normal) >= 0;
    };
    if (inside(a, b) && inside(b, c) && inside(c, a)) {
      return std::abs((p - a).dot(normal)) / normal.norm();
    }
  }
  return std::min({to_segment_m(p, a, b), to_segment_m(p, b, c), to_segment_m(p, c, a)});
}

double to_mesh_m(const Point& p, const TriangleMesh& mesh) {
  double nearest = SceneTruth::kReach_m;
  for (const auto& triangle : mesh.triangles) {
    std::array<Point, 3> corners;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& v = mesh.vertices[triangle[i]];
      corners[i] = Point(v[0], v[1], v[2]);
    }
    nearest = std::min(nearest, to_triangle_m(p, corners));
  }
  return nearest;
}

/// Objects by where they may be touched from.
class ObjectIndex {
 public:
  explicit ObjectIndex(std::vector<TownObject> objects) : objects_(std::move(objects)) {
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      const Footprint& footprint = objects_[i].footprint;
      const double radius = footprint.half_extent.norm() + SceneTruth::kReach_m;
      const Eigen::Array2d low = footprint.center.array() - radius;
      const Eigen::Array2d high = footprint.center.array() + radius;
      for (auto x = tile(low.x()); x <= tile(high.x()); ++x) {
        for (auto y = tile(low.y()); y <= tile(high.y()); ++y) tiles_[{x, y}].push_back(i);
      }
    }
  }

  template <typename Wanted>
  double distance_m(const Point& p, const Wanted& wanted) const {
    double nearest = SceneTruth::kReach_m;
    const auto found = tiles_.find({tile(p.x()), tile(p.y())});
    if (found == tiles_.end()) return nearest;
    for (const std::size_t i : found->second) {
      const TownObject& object = objects_[i];
      const double radius = object.footprint.half_extent.norm() + SceneTruth::kReach_m;
      const bool near = (p.head<2>() - object.footprint.center).norm() <= radius;
      if (near && wanted(object)) nearest = std::min(nearest, to_mesh_m(p, mesh(i)));
    }
    return nearest;
  }

 private:
  static std::int64_t tile(double coordinate_m) {
    return static_cast<std::int64_t>(std::floor(coordinate_m / 8));
  }
  const TriangleMesh& mesh(std::size_t i) const {
    const auto [entry, fresh] = meshes_.try_emplace(i);
    if (fresh) add_object(objects_[i], entry->second);
    return entry->second;
  }

  std::vector<TownObject> objects_;
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::size_t>> tiles_;
  mutable std::map<std::size_t, TriangleMesh> meshes_;
};

}  // namespace

struct SceneTruth::Impl {
  explicit Impl(const SimulatorOptions& options)
      : plan(options), objects(plan.objects()), tiles(caster, plan.ground, plan.objects()) {}

  /// Lowers the distance of each point to that from the vehicles on the move at a scan.
  void approach_moving(std::size_t scan, std::span<const Point> points,
                       std::span<double> distances_m) const {
    constexpr double kLongest_m = 3.5;
    for (const MovingCar& car : plan.moving_at(scan, plan.options.lidar.max_range_m)) {
      TriangleMesh mesh;
      add_vehicle(car.model, MeshBuilder(mesh, car.T_world_car));
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double apart_m = (car.T_world_car.translation() - points[i]).norm();
        if (apart_m > kLongest_m + kReach_m) continue;
        distances_m[i] = std::min(distances_m[i], to_mesh_m(points[i], mesh));
      }
    }
  }

  bool in_field_of_view(const Point& direction) const {
    const LidarModel& lidar = plan.options.lidar;
    const double elevation = std::asin(direction.z()) * kDegPerRad;
    return elevation <= lidar.top_elevation_deg && elevation >= lidar.bottom_elevation_deg;
  }

  bool returns(const RayCaster::Hit& hit) const {
    const double grazing_m = plan.options.lidar.grazing_range_m;
    return hit.range_m > 0 &&
           (grazing_m <= 0 || hit.range_m <= grazing_m * std::sqrt(hit.cosine_incidence));
  }

  DrivePlan plan;
  ObjectIndex objects;
  RayCaster caster;
  mutable TownTiles tiles;
};

SceneTruth::SceneTruth(const SimulatorOptions& options) {
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}
SceneTruth::~SceneTruth() = default;
SceneTruth::SceneTruth(SceneTruth&&) noexcept = default;

const Pose& SceneTruth::T_world_sensor(std::size_t scan) const {
  return impl_->plan.truth.at(scan).pose;
}

std::vector<double> SceneTruth::to_vehicles_m(std::span<const Point> points, std::size_t first,
                                              std::size_t count) const {
  std::vector<double> distances_m;
  for (const Point& point : points) {
    distances_m.push_back(impl_->objects.distance_m(
        point, [](const TownObject& object) { return object.kind == ObjectKind::kCar; }));
  }
  for (std::size_t scan = first; scan < first + count; ++scan) {
    impl_->approach_moving(scan, points, distances_m);
  }
  return distances_m;
}

double SceneTruth::to_standing_m(const Point& point) const {
  const auto ground = impl_->plan.ground.height_m(point.x(), point.y());
  const double to_ground = ground ? std::abs(point.z() - *ground) : kReach_m;
  return std::min(to_ground,
                  impl_->objects.distance_m(point, [](const TownObject&) { return true; }));
}

std::vector<bool> SceneTruth::in_sight(const Pose& T_world_sensor,
                                       std::span<const Point> points) const {
  constexpr double kSameSurface_m = 0.15;
  const Pose T_sensor_world = T_world_sensor.inverse();
  std::vector<Eigen::Vector3f> directions;
  std::vector<double> ranges;
  for (const Point& point : points) {
    const Point q = T_sensor_world * point;
    ranges.push_back(q.norm());
    directions.push_back(q.normalized().cast<float>());
  }
  const Point at = T_world_sensor.translation();
  const double reach = impl_->plan.options.lidar.max_range_m;
  std::vector<RayCaster::Hit> hits(points.size());
  impl_->caster.cast(impl_->tiles.around(at.x(), at.y(), reach), T_world_sensor, directions, reach,
                     impl_->plan.options.threads, hits);
  std::vector<bool> seen(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    seen[i] = impl_->in_field_of_view(directions[i].cast<double>()) && impl_->returns(hits[i]) &&
              hits[i].range_m >= ranges[i] - kSameSurface_m;
  }
  return seen;
}

}  // namespace cellmap
