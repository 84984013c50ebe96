#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <thread>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {
namespace {

constexpr double kMovedTranslationM = 1e-4;
constexpr double kMovedRotationRad = 1e-6;

/// Ceres' view of a pose: quaternion (x, y, z, w), then translation.
using PoseBlock = std::array<double, 7>;

PoseBlock to_block(const Pose& T) {
  const auto [x, y, z, qx, qy, qz, qw] = to_xyz_qxyzw(T);
  return {qx, qy, qz, qw, x, y, z};
}

Pose to_pose(const PoseBlock& b) {
  Pose T = Pose::Identity();
  T.linear() = Eigen::Quaterniond(b[3], b[0], b[1], b[2]).normalized().toRotationMatrix();
  T.translation() << b[4], b[5], b[6];
  return T;
}

/// `log` of geometry/pose.hpp from a unit quaternion, written so that automatic derivatives are
/// finite at the identity, where square roots have none.
template <typename T>
Eigen::Matrix<T, 6, 1> se3_log(Eigen::Quaternion<T> q, const Eigen::Matrix<T, 3, 1>& t) {
  using std::atan2;
  using std::sqrt;
  using std::tan;
  if (q.w() < T(0)) q.coeffs() = -q.coeffs();
  const T n2 = q.vec().squaredNorm();
  T scale, c;  // phi = scale * vec(q); V^-1 = I - W / 2 + c W^2
  if (n2 < T(1e-12)) {
    scale = T(2) / q.w() * (T(1) - n2 / (T(3) * q.w() * q.w()));
    c = T(1.0 / 12.0) + n2 / T(180.0);
  } else {
    const T n = sqrt(n2);
    const T half = atan2(n, q.w());
    scale = T(2) * half / n;
    c = (T(1) - half * q.w() / n) / (T(4) * half * half);
  }
  const Eigen::Matrix<T, 3, 1> phi = scale * q.vec();
  const Eigen::Matrix<T, 3, 1> W_t = phi.cross(t);
  Eigen::Matrix<T, 6, 1> xi;
  xi << t - T(0.5) * W_t + c * phi.cross(W_t), phi;
  return xi;
}

/// A matrix S with S^T S = information; rows of weightless directions are zero.
Matrix6d square_root(const Matrix6d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 *
                                                       (information + information.transpose()));
  return solver.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() *
         solver.eigenvectors().transpose();
}

/// S * log(T_from_to^-1 * T_from^-1 * T_to), with S whitening the *right* perturbation of the
/// measurement: log(M^-1 T) = Ad(M)^-1 log(T M^-1), so S = sqrt(information) * Ad(M).
class ConstraintResidual {
 public:
  explicit ConstraintResidual(const Constraint& constraint)
      : q_to_from_(constraint.T_from_to.linear().transpose()),
        t_from_to_(constraint.T_from_to.translation()),
        whitening_(square_root(constraint.information) * adjoint(constraint.T_from_to)) {
    q_to_from_.normalize();
  }

  template <typename T>
  bool operator()(const T* from, const T* to, T* residual) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Eigen::Quaternion<T>> q_from(from), q_to(to);
    const Eigen::Map<const Vector3> t_from(from + 4), t_to(to + 4);
    const Eigen::Quaternion<T> q_measured = q_to_from_.cast<T>();
    const Vector3 t_relative = q_from.conjugate() * (t_to - t_from);
    const Eigen::Quaternion<T> q_error = q_measured * (q_from.conjugate() * q_to);
    const Vector3 t_error = q_measured * (t_relative - t_from_to_.cast<T>());
    Eigen::Map<Eigen::Matrix<T, 6, 1>> out(residual);
    out = whitening_.cast<T>() * se3_log<T>(q_error, t_error);
    return true;
  }

 private:
  Eigen::Quaterniond q_to_from_;
  Eigen::Vector3d t_from_to_;
  Matrix6d whitening_;
};

using ConstraintCost = ceres::AutoDiffCostFunction<ConstraintResidual, 6, 7, 7>;
using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;

/// Positions of a graph's nodes in arrays.
class NodeTable {
 public:
  explicit NodeTable(const PoseGraph& graph) {
    for (const auto& [id, T] : graph.nodes) {
      if (!is_rigid(T)) {
        throw Error(ErrorCode::kInvalidArgument,
                    "CELL " + std::to_string(id.value) + " has a pose that is not rigid");
      }
      ids_.push_back(id);
      blocks_.push_back(to_block(T));
    }
  }

  std::size_t size() const { return ids_.size(); }
  CellId id(std::size_t i) const { return ids_[i]; }
  PoseBlock& block(std::size_t i) { return blocks_[i]; }

  std::size_t position(CellId id) const {
    const auto found = std::lower_bound(ids_.begin(), ids_.end(), id);
    if (found == ids_.end() || *found != id) {
      throw Error(ErrorCode::kInvalidArgument, "a constraint names CELL " +
                                                   std::to_string(id.value) +
                                                   ", which is not in the pose graph");
    }
    return static_cast<std::size_t>(found - ids_.begin());
  }

 private:
  std::vector<CellId> ids_;  // ascending
  std::vector<PoseBlock> blocks_;
};

/// The lowest node of the component of each node (union-find with path halving).
class Components {
 public:
  explicit Components(std::size_t nodes) : lowest_(nodes) {
    std::iota(lowest_.begin(), lowest_.end(), std::size_t{0});
  }
  std::size_t lowest(std::size_t i) {
    for (; lowest_[i] != i; i = lowest_[i]) lowest_[i] = lowest_[lowest_[i]];
    return i;
  }
  void join(std::size_t a, std::size_t b) {
    a = lowest(a);
    b = lowest(b);
    lowest_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> lowest_;
};

/// Owns what its Ceres problem refers to, so that one problem serves every stage of the loss.
class Problem {
 public:
  Problem(const PoseGraph& graph, const PoseGraphOptions& options)
      : options_(options), nodes_(graph), components_(graph.nodes.size()), problem_(ownership()) {
    for (const Constraint& constraint : graph.constraints) add(constraint);
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      double* block = nodes_.block(i).data();
      if (!problem_.HasParameterBlock(block)) continue;
      problem_.SetManifold(block, &manifold_);
      if (components_.lowest(i) == i) problem_.SetParameterBlockConstant(block);
    }
  }

  bool empty() const { return problem_.NumResidualBlocks() == 0; }
  NodeTable& nodes() { return nodes_; }
  bool is_fixed(std::size_t i) { return components_.lowest(i) == i; }

  ceres::Solver::Summary solve() {
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = options_.max_iterations;
    solver.num_threads = options_.threads > 0
                             ? options_.threads
                             : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    solver.function_tolerance = 1e-9;
    solver.parameter_tolerance = 1e-10;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    return summary;
  }

 private:
  static ceres::Problem::Options ownership() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  void add(const Constraint& constraint) {
    validate(constraint);
    const std::size_t from = nodes_.position(constraint.from), to = nodes_.position(constraint.to);
    const bool robust = constraint.kind == ConstraintKind::kLoop && options_.loop_loss_scale > 0;
    problem_.AddResidualBlock(new ConstraintCost(new ConstraintResidual(constraint)),
                              robust ? &loss_ : nullptr, nodes_.block(from).data(),
                              nodes_.block(to).data());
    components_.join(from, to);
  }

  PoseGraphOptions options_;
  NodeTable nodes_;
  Components components_;
  PoseManifold manifold_;
  ceres::CauchyLoss loss_{std::max(options_.loop_loss_scale, 1e-3)};
  ceres::Problem problem_;
};

bool has_moved(const Pose& before, const Pose& after) {
  return (before.translation() - after.translation()).norm() > kMovedTranslationM ||
         angle_between_rad(before, after) > kMovedRotationRad;
}

/// Writes back what moved; everything else keeps its bits, so that readers see no change.
std::size_t move_nodes(PoseGraph& graph, Problem& problem) {
  std::size_t moved = 0;
  for (std::size_t i = 0; i < problem.nodes().size(); ++i) {
    if (problem.is_fixed(i)) continue;
    Pose& T = graph.nodes.at(problem.nodes().id(i));
    const Pose optimised = to_pose(problem.nodes().block(i));
    if (!has_moved(T, optimised)) continue;
    T = optimised;
    ++moved;
  }
  return moved;
}

}  // namespace

void PoseGraphOptions::validate() const {
  if (max_iterations < 1 || max_iterations > 10'000) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "pose graph: max_iterations must be 1 to 10000, found " + std::to_string(max_iterations));
  }
  if (!(loop_loss_scale >= 0) || !std::isfinite(loop_loss_scale)) {
    throw Error(ErrorCode::kInvalidArgument, "pose graph: loop_loss_scale must be 0 or greater");
  }
  if (threads < 0 || threads > 1024) {
    throw Error(ErrorCode::kInvalidArgument,
                "pose graph: threads must be 0 (all) to 1024, found " + std::to_string(threads));
  }
}

PoseGraphSummary optimize(PoseGraph& graph, const PoseGraphOptions& options) {
  options.validate();
  Problem problem(graph, options);
  PoseGraphSummary summary;
  if (problem.empty()) {
    summary.converged = true;
    return summary;
  }
  const ceres::Solver::Summary solved = problem.solve();
  summary.converged = solved.termination_type == ceres::CONVERGENCE;
  summary.iterations = static_cast<int>(solved.iterations.size()) - 1;
  summary.initial_cost = solved.initial_cost;
  summary.final_cost = solved.final_cost;
  if (solved.IsSolutionUsable() && std::isfinite(solved.final_cost)) {
    summary.moved = move_nodes(graph, problem);
  }
  return summary;
}

}  // namespace cellmap
