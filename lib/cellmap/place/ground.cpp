#include "cellmap/place/ground.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "cellmap/geometry/angle.hpp"

namespace cellmap {
namespace {

/// Of so many points nine planes are fitted, and of more the best of them.
constexpr std::size_t kFewPoints = 300, kMostGroundPoints = 1'500;
constexpr double kNearestM = 3.0, kFarthestM = 25.0;
constexpr double kStartLeanRad = 8 * kRadPerDeg, kMostLeanRad = 15 * kRadPerDeg;
constexpr double kLowestGroundM = -4.0, kHighestGroundM = -0.2;
constexpr double kAgreeM = 0.15, kLeastShare = 0.25;

/// The plane z = slope . (x, y) + z0.
struct GroundPlane {
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  double z0 = 0;

  double above(const Eigen::Vector3d& p) const { return p.z() - slope.dot(p.head<2>()) - z0; }
};

std::vector<Eigen::Vector3d> evenly(const std::vector<Eigen::Vector3d>& points, std::size_t count) {
  if (points.size() <= count) return points;
  std::vector<Eigen::Vector3d> few;
  for (std::size_t k = 0; k < count; ++k) few.push_back(points[k * points.size() / count]);
  return few;
}

/// Points that the ground may pass through if the sensor leans no more than it may.
std::vector<Eigen::Vector3d> possible_ground(const PointCloud& points) {
  std::vector<Eigen::Vector3d> found;
  const double most_slope = std::tan(kMostLeanRad);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = points[i].cast<double>();
    const double range = p.head<2>().norm();
    if (!(range >= kNearestM && range <= kFarthestM)) continue;
    if (p.z() > kHighestGroundM + most_slope * range || p.z() < kLowestGroundM - most_slope * range)
      continue;
    found.push_back(p);
  }
  return evenly(found, kMostGroundPoints);
}

/// Of planes with this slope, the lowest height at which many points lie.
double likely_height(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector2d& slope) {
  constexpr double kBinM = 0.2;
  constexpr auto kBins = static_cast<std::size_t>((kHighestGroundM - kLowestGroundM) / kBinM);
  std::array<std::size_t, kBins> count{};
  for (const Eigen::Vector3d& p : points) {
    const double bin = (p.z() - slope.dot(p.head<2>()) - kLowestGroundM) / kBinM;
    if (bin >= 0 && bin < static_cast<double>(kBins)) ++count[static_cast<std::size_t>(bin)];
  }
  const auto most = std::max_element(count.begin(), count.end());
  return kLowestGroundM + (static_cast<double>(most - count.begin()) + 0.5) * kBinM;
}

GroundPlane improved(const std::vector<Eigen::Vector3d>& points, GroundPlane plane) {
  for (const double width_m : {0.8, 0.8, 0.6, 0.4, 0.3, 0.2, 0.15, 0.1, 0.1}) {
    Eigen::Matrix3d H = 1e-3 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : points) {
      const double r = plane.above(p), w = 1 / (1 + r * r / (width_m * width_m));
      const Eigen::Vector3d J(p.x(), p.y(), 1);
      H += w * w * J * J.transpose();
      g += w * w * r * J;
    }
    const Eigen::Vector3d step = H.ldlt().solve(g);
    plane.slope += step.head<2>();
    plane.z0 += step.z();
  }
  return plane;
}

std::size_t agreeing(const std::vector<Eigen::Vector3d>& points, const GroundPlane& plane) {
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(),
                    [&](const Eigen::Vector3d& p) { return std::abs(plane.above(p)) <= kAgreeM; }));
}

Pose standing_on(const GroundPlane& plane) {
  const Eigen::Vector3d up = Eigen::Vector3d(-plane.slope.x(), -plane.slope.y(), 1).normalized();
  Pose T = Pose::Identity();
  T.linear() = Eigen::Quaterniond::FromTwoVectors(up, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  // The sensor's distance from the plane.
  T.translation().z() = -plane.z0 * up.z();
  return T;
}

}  // namespace

GroundFrame fit_ground(const PointCloud& cloud) {
  GroundFrame frame;
  frame.T_ground_sensor.translation().z() = kUsualHeightM;
  const std::vector<Eigen::Vector3d> points = possible_ground(cloud);
  if (points.size() < 50) return frame;
  const std::vector<Eigen::Vector3d> few = evenly(points, kFewPoints);
  GroundPlane best;
  std::size_t most = 0;
  for (int start = -1; start < 8; ++start) {
    GroundPlane plane;
    if (start >= 0) {
      const double towards = start * std::numbers::pi / 4;
      plane.slope = std::tan(kStartLeanRad) * Eigen::Vector2d(std::cos(towards), std::sin(towards));
    }
    plane.z0 = likely_height(few, plane.slope);
    plane = improved(few, plane);
    const std::size_t agree = agreeing(few, plane);
    const bool possible = plane.z0 >= kLowestGroundM && plane.z0 <= kHighestGroundM &&
                          plane.slope.norm() <= std::tan(kMostLeanRad);
    if (!possible || agree <= most) continue;
    best = plane;
    most = agree;
  }
  if (most == 0) return frame;
  best = improved(points, best);
  most = agreeing(points, best);
  if (static_cast<double>(most) < kLeastShare * static_cast<double>(points.size())) return frame;
  return {standing_on(best), true};
}

}  // namespace cellmap
