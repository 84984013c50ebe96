#include "cellmap/evaluation/point_registration.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

/// Enough that noise does not tilt the plane, few enough that it stays on one surface: of 6 to 30,
/// this many registered best to clouds of 0.1 to 0.4 m.
constexpr std::size_t kNeighbours = 12;
constexpr std::size_t kMaxNeighbours = 64;
constexpr std::size_t kGrain = 1024;

/// What a residual counts for.
double weight_of(double distance_m, const RegistrationStage& stage) {
  const double ratio = distance_m / stage.kernel_width_m;
  const double one_more = 1 + ratio * ratio;
  switch (stage.kernel) {
    case RobustKernel::kNone:
      return 1;
    case RobustKernel::kCauchy:
      return 1 / one_more;
    case RobustKernel::kGemanMcClure:
      return 1 / (one_more * one_more);
  }
  return 1;
}

struct Normal {
  Matrix6d H = Matrix6d::Zero();
  Tangent g = Tangent::Zero();
  std::size_t points = 0;
};

/// The normal equations of the left perturbation exp(xi) * T (paper, Eq. 1 to 5, with the nearest
/// point's plane).
Normal normal_equations(const PointTarget& target, const PointCloud& scan, std::size_t step,
                        const Pose& T, const RegistrationStage& stage) {
  Normal system;
  for (std::size_t i = 0; i < scan.size(); i += step) {
    const Eigen::Vector3d p = T * scan[i].cast<double>();
    const auto found = target.tree().nearest(p.cast<float>());
    if (found.squared_distance_m2 > stage.gate_m * stage.gate_m) continue;
    const Eigen::Vector3d normal = target.normals()[found.index].cast<double>();
    const double distance = normal.dot(p - target.points()[found.index].cast<double>());
    Tangent jacobian;
    jacobian << normal, p.cross(normal);
    const double weight = weight_of(distance, stage);
    system.H += weight * jacobian * jacobian.transpose();
    system.g += weight * distance * jacobian;
    ++system.points;
  }
  return system;
}

std::size_t step_for(std::size_t points, const RegistrationStage& stage) {
  return stage.max_points == 0 ? 1 : (points + stage.max_points - 1) / stage.max_points;
}

}  // namespace

PointCloud estimate_normals(const PointCloud& points, std::size_t neighbours, int threads) {
  PointCloud normals = points;
  if (points.empty()) return normals;
  const NearestPoints tree(points);
  const std::size_t count = std::min(neighbours, kMaxNeighbours);
  parallel_for(points.size(), kGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::array<NearestPoints::Neighbour, kMaxNeighbours> found;
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t n = tree.nearest(points[i], std::span(found).first(count));
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (std::size_t k = 0; k < n; ++k) mean += points[found[k].index].cast<double>();
      mean /= static_cast<double>(n);
      Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
      for (std::size_t k = 0; k < n; ++k) {
        const Eigen::Vector3d d = points[found[k].index].cast<double>() - mean;
        scatter += d * d.transpose();
      }
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
      solver.computeDirect(scatter);
      const Eigen::Vector3f normal = solver.eigenvectors().col(0).cast<float>();
      normals.x[i] = normal.x();
      normals.y[i] = normal.y();
      normals.z[i] = normal.z();
    }
  });
  return normals;
}

PointTarget::PointTarget(PointCloud points, PointCloud normals, int threads)
    : points_(std::make_unique<const PointCloud>(std::move(points))),
      normals_(normals.empty() ? estimate_normals(*points_, kNeighbours, threads)
                               : std::move(normals)),
      tree_(*points_) {}

RegistrationResult register_to_points(const PointTarget& target, const PointCloud& scan,
                                      const Pose& T_target_scan_initial,
                                      const RegistrationOptions& options) {
  const auto stages = options.stages.empty() ? default_registration_stages() : options.stages;
  RegistrationResult result;
  result.T_target_source = T_target_scan_initial;
  if (target.points().empty()) return result;
  for (std::size_t s = 0; s < stages.size(); ++s) {
    const std::size_t step = step_for(scan.size(), stages[s]);
    for (int k = 0; k < stages[s].max_iterations && !result.converged; ++k) {
      const Normal system = normal_equations(target, scan, step, result.T_target_source, stages[s]);
      if (system.points < options.min_points_in_gate) return result;
      const Tangent xi = -system.H.ldlt().solve(system.g);
      if (!xi.allFinite()) return result;
      result.T_target_source = exp(xi) * result.T_target_source;
      ++result.iterations;
      result.converged = s + 1 == stages.size() &&
                         xi.head<3>().norm() < options.convergence_translation_m &&
                         xi.tail<3>().norm() < options.convergence_rotation_rad;
    }
  }
  return result;
}

}  // namespace cellmap
