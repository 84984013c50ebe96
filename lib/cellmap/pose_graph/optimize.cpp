#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <numeric>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/constraint_residual.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {
namespace {

constexpr double kMovedTranslationM = 1e-4;
constexpr double kMovedRotationRad = 1e-6;

/// A step in which no node moves farther than this is the last one; steps shrink quadratically, so
/// what it leaves is far below what counts as moved.
constexpr double kLastStepM = 1e-5;
constexpr double kLastStepRad = 1e-7;

/// A loop longer than this many loss scales is stretched: it pulls so little that what it
/// contradicts may hold it open. By chance no true loop is so long at the solution.
constexpr double kStretchedScales = 2;

/// Relative decrease of the cost that ends the approach; the solution need not be precise.
constexpr double kApproachTolerance = 1e-3;

/// Relative changes of the cost and of the poses that may be nothing but rounding.
constexpr double kRoundingTolerance = 1e-14;

/// So large that steps are Gauss-Newton's; Ceres halves it and more where such a step fails.
constexpr double kTrustRegionRadius = 1e16;

using Poses = std::vector<Pose>;

/// Ceres' parameter block of a node is its 4x4 matrix.
constexpr int kPoseNumbers = 16;
static_assert(sizeof(Pose) == kPoseNumbers * sizeof(double));

Pose to_pose(const double* numbers) { return Pose(Eigen::Map<const Eigen::Matrix4d>(numbers)); }

using PoseJacobian = Eigen::Matrix<double, 6, kPoseNumbers, Eigen::RowMajor>;

/// Steps are right perturbations, T * exp(d). Ceres only ever uses the product of a residual's
/// Jacobian and this one, so residuals give their derivatives by d in the first six columns, and
/// this one picks them out.
class RightPerturbation : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseNumbers; }
  int TangentSize() const override { return 6; }

  bool Plus(const double* x, const double* d, double* sum) const override {
    const Pose T = to_pose(x) * exp(Eigen::Map<const Tangent>(d));
    std::copy_n(T.data(), kPoseNumbers, sum);
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, kPoseNumbers, 6, Eigen::RowMajor>> out(jacobian);
    out.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* difference) const override {
    Eigen::Map<Tangent>{difference} = log(to_pose(x).inverse() * to_pose(y));
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<PoseJacobian>{jacobian}.setIdentity();
    return true;
  }
};

class ConstraintCost : public ceres::SizedCostFunction<6, kPoseNumbers, kPoseNumbers> {
 public:
  explicit ConstraintCost(const Constraint& constraint) : residual_(constraint) {}

  bool Evaluate(const double* const* poses, double* error, double** jacobians) const override {
    const Pose T_from = to_pose(poses[0]), T_to = to_pose(poses[1]);
    Eigen::Map<Tangent> error_out(error);
    if (jacobians == nullptr) {
      error_out = residual_.error(T_from, T_to);
      return true;
    }
    const ConstraintResidual::Linear linear = residual_.linearise(T_from, T_to);
    error_out = linear.error;
    write(linear.by_from, jacobians[0]);
    write(linear.by_to, jacobians[1]);
    return true;
  }

  double squared_error(const Pose& T_from, const Pose& T_to) const {
    return residual_.error(T_from, T_to).squaredNorm();
  }

 private:
  static void write(const Matrix6d& derivative, double* jacobian) {
    if (jacobian == nullptr) return;  // of a fixed pose
    Eigen::Map<PoseJacobian> out(jacobian);
    out.leftCols<6>() = derivative;
    out.rightCols<kPoseNumbers - 6>().setZero();
  }

  ConstraintResidual residual_;
};

/// Dynamic covariance scaling (Agarwal et al., ICRA 2013): squared errors up to c^2 count in full,
/// so that the steps towards a solution of true loops shrink quadratically; beyond it the weight
/// falls with the fourth power of the error, so that a false loop does not bend the map.
class ScaledCovariance : public ceres::LossFunction {
 public:
  explicit ScaledCovariance(double scale) : c2_(scale * scale) {}

  void Evaluate(double s, double rho[3]) const override {
    if (s <= c2_) {
      rho[0] = s, rho[1] = 1, rho[2] = 0;
      return;
    }
    const double w = 2 * c2_ / (c2_ + s);
    rho[0] = c2_ * (3 - 2 * w);
    rho[1] = w * w;
    rho[2] = -2 * w * w / (c2_ + s);
  }

 private:
  double c2_;
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

bool has_moved(const Pose& before, const Pose& after, double translation_m, double rotation_rad) {
  return (before.translation() - after.translation()).norm() > translation_m ||
         angle_between_rad(before, after) > rotation_rad;
}

/// Ends the solution with the first step in which no pose moves by more than the bound.
class LastStep : public ceres::IterationCallback {
 public:
  explicit LastStep(const Poses& poses) : poses_(poses), before_(poses) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& iteration) override {
    if (iteration.iteration == 0 || !iteration.step_is_successful) return ceres::SOLVER_CONTINUE;
    bool moved = false;
    for (std::size_t i = 0; i < poses_.size() && !moved; ++i) {
      moved = has_moved(before_[i], poses_[i], kLastStepM, kLastStepRad);
    }
    before_ = poses_;
    return moved ? ceres::SOLVER_CONTINUE : ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }

 private:
  const Poses& poses_;
  Poses before_;
};

/// Owns what its Ceres problem refers to, so that one problem serves every loss.
class Problem {
 public:
  Problem(const PoseGraph& graph, const PoseGraphOptions& options)
      : options_(options),
        bounded_pull_(std::max(options.loop_loss_scale, kLeastLossScale)),
        scaled_covariance_(std::max(options.loop_loss_scale, kLeastLossScale)),
        problem_(problem_options()) {
    for (const auto& [id, T] : graph.nodes) {
      if (!is_rigid(T)) {
        throw Error(ErrorCode::kInvalidArgument,
                    "CELL " + std::to_string(id.value) + " has a pose that is not rigid");
      }
      ids_.push_back(id);
      poses_.push_back(T);
    }
    for (const Constraint& constraint : graph.constraints) add(constraint);
    fix_gauge();
  }

  const Poses& poses() const { return poses_; }

  PoseGraphSummary solve() {
    if (terms_.empty()) return {.converged = true};
    PoseGraphSummary summary;
    summary.initial_cost = cost();
    if (has_stretched_loop()) {
      loop_loss_.Reset(&bounded_pull_, ceres::DO_NOT_TAKE_OWNERSHIP);
      summary.iterations = steps(run(options_.max_iterations, kApproachTolerance));
    }
    if (options_.loop_loss_scale > 0) {
      loop_loss_.Reset(&scaled_covariance_, ceres::DO_NOT_TAKE_OWNERSHIP);
    }
    const ceres::Solver::Summary solved =
        run(options_.max_iterations - summary.iterations, kRoundingTolerance);
    summary.iterations += steps(solved);
    summary.final_cost = cost();
    summary.converged = solved.termination_type == ceres::CONVERGENCE ||
                        solved.termination_type == ceres::USER_SUCCESS;
    return summary;
  }

 private:
  static constexpr double kLeastLossScale = 1e-3;

  struct Term {
    Term(const Constraint& constraint, std::size_t from_node, std::size_t to_node)
        : cost(constraint),
          from(from_node),
          to(to_node),
          is_loop(constraint.kind == ConstraintKind::kLoop) {}

    ConstraintCost cost;
    std::size_t from, to;  ///< nodes
    bool is_loop;
  };

  static ceres::Problem::Options problem_options() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  void add(const Constraint& constraint) {
    validate(constraint);
    Term& term =
        terms_.emplace_back(constraint, position(constraint.from), position(constraint.to));
    problem_.AddResidualBlock(&term.cost, term.is_loop ? &loop_loss_ : nullptr,
                              poses_[term.from].data(), poses_[term.to].data());
  }

  std::size_t position(CellId id) const {
    const auto found = std::lower_bound(ids_.begin(), ids_.end(), id);
    if (found == ids_.end() || *found != id) {
      throw Error(ErrorCode::kInvalidArgument, "a constraint names CELL " +
                                                   std::to_string(id.value) +
                                                   ", which is not in the pose graph");
    }
    return static_cast<std::size_t>(found - ids_.begin());
  }

  double loss(const Term& term) const {
    const double s = term.cost.squared_error(poses_[term.from], poses_[term.to]);
    if (!term.is_loop || options_.loop_loss_scale == 0) return s;
    double rho[3];
    scaled_covariance_.Evaluate(s, rho);
    return rho[0];
  }

  double cost() const {
    return 0.5 * std::accumulate(terms_.begin(), terms_.end(), 0.0,
                                 [&](double sum, const Term& term) { return sum + loss(term); });
  }

  bool has_stretched_loop() const {
    const double limit = std::pow(kStretchedScales * options_.loop_loss_scale, 2);
    return limit > 0 && std::any_of(terms_.begin(), terms_.end(), [&](const Term& term) {
             return term.is_loop &&
                    term.cost.squared_error(poses_[term.from], poses_[term.to]) > limit;
           });
  }

  ceres::Solver::Summary run(int max_iterations, double cost_tolerance) {
    LastStep last_step(poses_);
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = max_iterations;
    solver.initial_trust_region_radius = kTrustRegionRadius;
    solver.function_tolerance = cost_tolerance;
    solver.gradient_tolerance = 0;
    solver.parameter_tolerance = kRoundingTolerance;
    solver.num_threads = 1;
    solver.logging_type = ceres::SILENT;
    solver.callbacks = {&last_step};
    solver.update_state_every_iteration = true;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    return summary;
  }

  static int steps(const ceres::Solver::Summary& summary) {
    return static_cast<int>(summary.iterations.size()) - 1;
  }

  /// Every component's lowest node stays.
  void fix_gauge() {
    Components components(poses_.size());
    for (const Term& term : terms_) components.join(term.from, term.to);
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      double* block = poses_[i].data();
      if (!problem_.HasParameterBlock(block)) continue;
      problem_.SetManifold(block, &manifold_);
      if (components.lowest(i) == i) problem_.SetParameterBlockConstant(block);
    }
  }

  const PoseGraphOptions& options_;
  std::vector<CellId> ids_;  // ascending
  Poses poses_;
  std::deque<Term> terms_;  // does not move what Ceres points at
  RightPerturbation manifold_;
  ceres::CauchyLoss bounded_pull_;
  ScaledCovariance scaled_covariance_;
  ceres::LossFunctionWrapper loop_loss_{nullptr, ceres::DO_NOT_TAKE_OWNERSHIP};
  ceres::Problem problem_;
};

Pose normalised(Pose T) {
  T.linear() = Eigen::Quaterniond(T.linear()).normalized().toRotationMatrix();
  return T;
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
  PoseGraphSummary summary = problem.solve();
  auto optimised = problem.poses().cbegin();
  for (auto& [id, T] : graph.nodes) {
    // What moved less keeps its bits, so that readers see no change.
    const Pose& T_optimised = *optimised++;
    if (!has_moved(T, T_optimised, kMovedTranslationM, kMovedRotationRad)) continue;
    T = normalised(T_optimised);
    ++summary.moved;
  }
  return summary;
}

}  // namespace cellmap
