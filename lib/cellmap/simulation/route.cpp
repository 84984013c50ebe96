#include "cellmap/simulation/route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::simulation {
namespace {

constexpr double kVertexSpacing_m = 1.0;

/// p_sensor = R * p_camera: camera z is forward, x right, y down.
Pose sensor_from_camera() {
  Pose T = Pose::Identity();
  T.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return T;
}

/// Which local axis the vehicle moves along tells the frame of its poses.
PoseFrame frame_by_motion(const Trajectory& trajectory, const std::filesystem::path& file) {
  Eigen::Vector3d along = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    const Pose& before = trajectory[i - 1].pose;
    along +=
        (before.linear().transpose() * (trajectory[i].pose.translation() - before.translation()))
            .cwiseAbs();
  }
  if (along.x() > 2 * along.y() && along.x() > 2 * along.z()) return PoseFrame::kSensor;
  if (along.z() > 2 * along.x() && along.z() > 2 * along.y()) return PoseFrame::kCamera;
  throw Error(ErrorCode::kInvalidArgument,
              "expected a route that moves along its own x axis (sensor frame) or z axis (camera "
              "frame), found neither in " +
                  file.string() + "; state the frame of its poses");
}

/// A street plan: corners joined by straight streets.
std::vector<Eigen::Vector2d> town_corners() {
  return {{0, 0},     {112, 0},  {112, 72}, {0, 72}, {0, 0}, {200, 0},
          {200, -64}, {56, -64}, {56, 72},  {0, 72}, {0, 4}};
}

std::vector<Eigen::Vector2d> city_corners() {
  return {{0, 0},     {210, 0},   {210, 165}, {95, 165},  {95, 0},    {405, 0},
          {405, 165}, {290, 165}, {290, 350}, {95, 350},  {95, 270},  {405, 270},
          {405, 80},  {520, 80},  {520, 350}, {290, 350}, {290, 165}, {0, 165},
          {0, 350},   {95, 350},  {95, 270},  {245, 270}};
}

/// The corners joined by arcs, one point every half metre or so.
std::vector<Eigen::Vector2d> rounded(const std::vector<Eigen::Vector2d>& corners, double radius_m) {
  std::vector<Eigen::Vector2d> line;
  const auto straight_to = [&](const Eigen::Vector2d& end) {
    const Eigen::Vector2d start = line.back();
    const int steps = std::max(1, static_cast<int>((end - start).norm() / 0.5));
    for (int k = 1; k <= steps; ++k) line.push_back(start + (end - start) * k / steps);
  };
  line.push_back(corners.front());
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Eigen::Vector2d in = (corners[i] - corners[i - 1]).normalized();
    const Eigen::Vector2d out = (corners[i + 1] - corners[i]).normalized();
    const double turn = std::atan2(in.x() * out.y() - in.y() * out.x(), in.dot(out));
    const double tangent_m = radius_m * std::tan(std::abs(turn) / 2);
    straight_to(corners[i] - tangent_m * in);
    const double side = turn < 0 ? -1 : 1;
    const Eigen::Vector2d center = line.back() + side * radius_m * Eigen::Vector2d(-in.y(), in.x());
    const Eigen::Vector2d from_center = line.back() - center;
    const int steps = std::max(1, static_cast<int>(std::abs(turn) * radius_m / 0.5));
    for (int k = 1; k <= steps; ++k) {
      line.push_back(center + Eigen::Rotation2Dd(turn * k / steps) * from_center);
    }
  }
  straight_to(corners.back());
  return line;
}

/// Height of the town's ground: hills of up to 3 m, level with a level tangent at the origin, so
/// that the drive starts upright.
double hill_height_m(double x, double y) {
  const double across = 1 - std::cos(x / 55.0), along = 1 - std::cos(y / 40.0);
  return 0.9 * across - 0.7 * along + 0.5 * across * along;
}

/// x forward along `heading`, z up from the slope of the hills.
Eigen::Matrix3d upright_on_hill(const Eigen::Vector2d& p, double heading_rad) {
  constexpr double step_m = 0.5;
  const double slope_x =
      (hill_height_m(p.x() + step_m, p.y()) - hill_height_m(p.x() - step_m, p.y())) / (2 * step_m);
  const double slope_y =
      (hill_height_m(p.x(), p.y() + step_m) - hill_height_m(p.x(), p.y() - step_m)) / (2 * step_m);
  const Eigen::Vector3d up = Eigen::Vector3d(-slope_x, -slope_y, 1).normalized();
  const Eigen::Vector3d ahead(std::cos(heading_rad), std::sin(heading_rad), 0);
  const Eigen::Vector3d forward = (ahead - up * up.dot(ahead)).normalized();
  Eigen::Matrix3d R;
  R << forward, up.cross(forward), up;
  return R;
}

/// Speed at every vertex: what the bend there allows, reached and left with a bounded acceleration.
std::vector<double> speeds(const std::vector<Eigen::Vector2d>& line) {
  constexpr double cruise_mps = 11.0, lateral_mps2 = 2.5, along_mps2 = 1.8;
  std::vector<double> speed(line.size(), cruise_mps);
  for (std::size_t i = 1; i + 1 < line.size(); ++i) {
    const Eigen::Vector2d a = line[i] - line[i - 1], b = line[i + 1] - line[i];
    const double turn = std::abs(std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b)));
    const double curvature = turn / (0.5 * (a.norm() + b.norm()));
    if (curvature > 1e-3) speed[i] = std::min(cruise_mps, std::sqrt(lateral_mps2 / curvature));
  }
  const auto limit = [&](std::size_t from, std::size_t to) {
    const double d = (line[to] - line[from]).norm();
    speed[to] = std::min(speed[to], std::sqrt(speed[from] * speed[from] + 2 * along_mps2 * d));
  };
  for (std::size_t i = 1; i < line.size(); ++i) limit(i - 1, i);
  for (std::size_t i = line.size() - 1; i > 0; --i) limit(i, i - 1);
  return speed;
}

/// A drive along the corners.
Route drive_along(const std::vector<Eigen::Vector2d>& corners, double rate_hz) {
  const std::vector<Eigen::Vector2d> line = rounded(corners, 10.0);
  const std::vector<double> speed = speeds(line);
  Route route;
  double segment_start_s = 0;
  for (std::size_t i = 1; i < line.size(); ++i) {
    const Eigen::Vector2d step = line[i] - line[i - 1];
    const double duration_s = step.norm() / (0.5 * (speed[i] + speed[i - 1]));
    const Eigen::Vector2d before = i > 1 ? Eigen::Vector2d(line[i] - line[i - 2]) : step;
    const Eigen::Vector2d after =
        i + 1 < line.size() ? Eigen::Vector2d(line[i + 1] - line[i - 1]) : step;
    const double heading = std::atan2(before.y(), before.x());
    const double turn =
        std::remainder(std::atan2(after.y(), after.x()) - heading, 2 * std::numbers::pi);
    for (;;) {
      const double time_s = static_cast<double>(route.size()) / rate_hz;
      const double share = (time_s - segment_start_s) / duration_s;
      if (share >= 1) break;
      const Eigen::Vector2d p = line[i - 1] + share * step;
      StampedPose sample{stamp_from_seconds(time_s), Pose::Identity()};
      sample.pose.linear() = upright_on_hill(p, heading + share * turn);
      sample.pose.translation() << p, hill_height_m(p.x(), p.y());
      route.push_back(sample);
    }
    segment_start_s += duration_s;
  }
  return route;
}

}  // namespace

Route town_route(double rate_hz) { return drive_along(town_corners(), rate_hz); }

Route city_route(double rate_hz) { return drive_along(city_corners(), rate_hz); }

Route spaced(const Route& route, double spacing_m) {
  Route sparse = {route.front()};
  double next_m = spacing_m, driven_m = 0;
  for (std::size_t i = 1; i < route.size(); ++i) {
    const StampedPose &a = route[i - 1], &b = route[i];
    const double step_m = (b.pose.translation() - a.pose.translation()).norm();
    for (; driven_m + step_m >= next_m && step_m > 0; next_m += spacing_m) {
      const double share = (next_m - driven_m) / step_m;
      const auto elapsed = static_cast<Stamp>(share * static_cast<double>(b.stamp - a.stamp));
      if (a.stamp + elapsed <= sparse.back().stamp) continue;
      sparse.push_back({a.stamp + elapsed, interpolate(a.pose, b.pose, share)});
    }
    driven_m += step_m;
  }
  if (sparse.size() < 2) sparse.push_back(route.back());
  return sparse;
}

Route route_from_file(const std::filesystem::path& file, PoseFrame frame) {
  const Trajectory trajectory = read_trajectory(file);
  if (trajectory.size() < 2) {
    throw Error(ErrorCode::kInvalidArgument, "expected a route of at least two poses, found " +
                                                 std::to_string(trajectory.size()) + " in " +
                                                 file.string());
  }
  if (frame == PoseFrame::kAuto) frame = frame_by_motion(trajectory, file);
  Route route(trajectory.poses().begin(), trajectory.poses().end());
  if (frame == PoseFrame::kCamera) {
    const Pose T_sensor_camera = sensor_from_camera();
    for (StampedPose& sample : route) {
      sample.pose = T_sensor_camera * sample.pose * T_sensor_camera.inverse();
    }
  }
  return route;
}

Eigen::Vector2d Centreline::Point::left() const {
  return {-std::sin(heading_rad), std::cos(heading_rad)};
}

Centreline::Centreline(const Route& route) {
  const auto plan = [](const Eigen::Vector3d& p) { return p.head<2>(); };
  for (const StampedPose& sample : route) {
    const Eigen::Vector3d& p = sample.pose.translation();
    const double step_m = vertices_.empty() ? 0 : (plan(p) - plan(vertices_.back())).norm();
    const double arc_m = vertices_.empty() ? 0 : arc_m_.back() + step_m;
    arc_of_pose_m_.push_back(arc_m);
    if (vertices_.empty() || step_m >= kVertexSpacing_m) {
      vertices_.push_back(p);
      arc_m_.push_back(arc_m);
    }
  }
  if (vertices_.size() < 2) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a route of at least 1 m on the ground plan, found one that stands still");
  }
}

Centreline::Point Centreline::at(double s_m) const {
  const auto after = std::upper_bound(arc_m_.begin() + 1, arc_m_.end() - 1, s_m);
  const auto i = static_cast<std::size_t>(after - arc_m_.begin());
  const Eigen::Vector2d a = vertices_[i - 1].head<2>(), b = vertices_[i].head<2>();
  const double share = std::clamp((s_m - arc_m_[i - 1]) / (arc_m_[i] - arc_m_[i - 1]), 0.0, 1.0);
  // Over four metres, so that the heading of a driven line does not jump from pose to pose.
  const std::size_t low = i > 2 ? i - 3 : 0, high = std::min(i + 2, vertices_.size() - 1);
  const Eigen::Vector2d chord = (vertices_[high] - vertices_[low]).head<2>();
  return {a + share * (b - a), std::atan2(chord.y(), chord.x())};
}

}  // namespace cellmap::simulation
