#include "cellmap/pose_graph/weighted_problem.hpp"

#include <ceres/ceres.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <numeric>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/components.hpp"
#include "cellmap/pose_graph/constraint_residual.hpp"

namespace cellmap {
namespace {

/// Relative changes of the cost and of the poses that may be nothing but rounding.
constexpr double kSolverTolerance = 1e-14;

/// So large that steps are Gauss-Newton's; Ceres halves it and more where such a step fails.
constexpr double kTrustRegionRadius = 1e16;

constexpr double kLeastLossScale = 1e-3;

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

/// The loss of one loop.
class LoopLoss : public ceres::LossFunction {
 public:
  LoopLoss(const WeightedProblem::Loss& loss, double scale) : loss_(loss), c2_(scale * scale) {}

  double weight = 1.0;

  void Evaluate(double s, double rho[3]) const override {
    evaluate_unweighted(s, rho);
    for (int i = 0; i < 3; ++i) rho[i] *= weight;
  }

 private:
  void evaluate_unweighted(double s, double rho[3]) const {
    if (loss_ == WeightedProblem::Loss::kCauchy) {
      const double share = 1 / (1 + s / c2_);
      rho[0] = c2_ * std::log1p(s / c2_), rho[1] = share, rho[2] = -share * share / c2_;
    } else if (loss_ == WeightedProblem::Loss::kScaled && s > c2_) {
      // Dynamic covariance scaling (Agarwal et al., ICRA 2013). That shorter residuals count in
      // full lets the steps towards a solution of true loops shrink quadratically.
      const double share = 2 * c2_ / (c2_ + s);
      rho[0] = c2_ * (3 - 2 * share);
      rho[1] = share * share;
      rho[2] = -2 * share * share / (c2_ + s);
    } else {
      rho[0] = s, rho[1] = 1, rho[2] = 0;
    }
  }

  const WeightedProblem::Loss& loss_;
  double c2_;
};

/// How far the farthest node goes from one pose list to another, in what counts as moved.
double farthest_move(const Poses& before, const Poses& after) {
  double farthest = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const double translation_m = (before[i].translation() - after[i].translation()).norm();
    // The sine of a small rotation's angle without the cost and the rounding of an arc cosine.
    const Eigen::Matrix3d R = before[i].linear().transpose() * after[i].linear();
    const double rotation_rad =
        0.5 * Eigen::Vector3d(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)).norm();
    farthest =
        std::max({farthest, translation_m / kMovedTranslationM, rotation_rad / kMovedRotationRad});
  }
  return farthest;
}

/// Ends the solution when the steps to come would move nothing by more than half of what counts as
/// moved: near the solution steps shrink by a constant factor or faster.
class LastStep : public ceres::IterationCallback {
 public:
  explicit LastStep(const Poses& poses) : poses_(poses), before_(poses) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& iteration) override {
    if (iteration.iteration == 0 || !iteration.step_is_successful) return ceres::SOLVER_CONTINUE;
    const double move = farthest_move(before_, poses_);
    before_ = poses_;
    const double factor = last_move_ > 0 ? move / last_move_ : 1.0;
    last_move_ = move;
    const bool is_last = move < kLastMove || (factor < 0.5 && move * factor < kLastMove / 2);
    return is_last ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  static constexpr double kLastMove = 0.1;
  const Poses& poses_;
  Poses before_;
  double last_move_ = 0;
};

/// CHOLMOD asks for four OpenMP threads at every supernode, whatever Ceres was told. On small
/// blocks waking them costs more than they do, and on a busy machine twice the whole solution.
class OneOpenMpThread {
 public:
  OneOpenMpThread() : before_(omp_get_max_active_levels()) { omp_set_max_active_levels(0); }
  ~OneOpenMpThread() { omp_set_max_active_levels(before_); }
  OneOpenMpThread(const OneOpenMpThread&) = delete;
  OneOpenMpThread& operator=(const OneOpenMpThread&) = delete;

 private:
  int before_;
};

}  // namespace

class WeightedProblem::Impl {
 public:
  Impl(const PoseGraph& graph, double loss_scale, int threads)
      : loss_scale_(std::max(loss_scale, kLeastLossScale)),
        threads_(threads),
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
    for (Pose& T : poses_) {
      if (problem_.HasParameterBlock(T.data())) problem_.SetManifold(T.data(), &manifold_);
    }
  }

  struct Term {
    Term(const Constraint& constraint, std::size_t from_node, std::size_t to_node,
         const WeightedProblem::Loss& shape, double scale)
        : cost(constraint),
          from(from_node),
          to(to_node),
          loss(shape, scale),
          has_loss(!is_trusted(constraint)) {}

    ConstraintCost cost;
    std::size_t from, to;  ///< nodes
    LoopLoss loss;
    bool has_loss;
  };

  double chi2(const Term& term) const {
    return term.cost.squared_error(poses_[term.from], poses_[term.to]);
  }

  double cost() const {
    return 0.5 *
           std::accumulate(terms_.begin(), terms_.end(), 0.0, [&](double sum, const Term& term) {
             double rho[3] = {chi2(term), 1, 0};
             if (term.has_loss) term.loss.Evaluate(rho[0], rho);
             return sum + rho[0];
           });
  }

  Solution solve(int max_iterations, double cost_tolerance) {
    if (terms_.empty()) return {.converged = true};
    fix_gauge();
    const OneOpenMpThread one_thread;
    LastStep last_step(poses_);
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = max_iterations;
    solver.initial_trust_region_radius = kTrustRegionRadius;
    solver.function_tolerance = std::max(cost_tolerance, kSolverTolerance);
    solver.gradient_tolerance = 0;
    solver.parameter_tolerance = kSolverTolerance;
    solver.num_threads = threads_;
    solver.logging_type = ceres::SILENT;
    solver.callbacks = {&last_step};
    solver.update_state_every_iteration = true;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    return {.converged = summary.termination_type == ceres::CONVERGENCE ||
                         summary.termination_type == ceres::USER_SUCCESS,
            .steps = static_cast<int>(summary.iterations.size()) - 1};
  }

  std::vector<CellId> ids_;  // ascending
  Poses poses_;
  std::deque<Term> terms_;  // does not move what Ceres points at
  Loss loss_ = Loss::kNone;

 private:
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
    Term& term = terms_.emplace_back(constraint, position(constraint.from), position(constraint.to),
                                     loss_, loss_scale_);
    problem_.AddResidualBlock(&term.cost, term.has_loss ? &term.loss : nullptr,
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

  /// The lowest node stays of every component that weights above 0 tie together.
  void fix_gauge() {
    Components components(poses_.size());
    for (const Term& term : terms_) {
      if (!term.has_loss || term.loss.weight > 0) components.join(term.from, term.to);
    }
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      double* block = poses_[i].data();
      if (!problem_.HasParameterBlock(block)) continue;
      if (components.lowest(i) == i) {
        problem_.SetParameterBlockConstant(block);
      } else {
        problem_.SetParameterBlockVariable(block);
      }
    }
  }

  double loss_scale_;
  int threads_;
  RightPerturbation manifold_;
  ceres::Problem problem_;
};

WeightedProblem::WeightedProblem(const PoseGraph& graph, double loss_scale, int threads)
    : impl_(std::make_unique<Impl>(graph, loss_scale, threads)) {}
WeightedProblem::~WeightedProblem() = default;

const Poses& WeightedProblem::poses() const { return impl_->poses_; }

void WeightedProblem::set_poses(const std::map<CellId, Pose>& poses) {
  std::transform(poses.begin(), poses.end(), impl_->poses_.begin(),
                 [](const auto& node) { return node.second; });
}

void WeightedProblem::set_poses(const Poses& poses) {
  std::copy(poses.begin(), poses.end(), impl_->poses_.begin());  // Ceres points at the elements
}

void WeightedProblem::set_loss(Loss loss) { impl_->loss_ = loss; }

void WeightedProblem::set_weight(std::size_t constraint, double weight) {
  impl_->terms_[constraint].loss.weight = weight;
}

double WeightedProblem::chi2(std::size_t constraint) const {
  return impl_->chi2(impl_->terms_[constraint]);
}

double WeightedProblem::weight(std::size_t constraint) const {
  const auto& term = impl_->terms_[constraint];
  if (!term.has_loss) return 1.0;
  double rho[3];
  term.loss.Evaluate(impl_->chi2(term), rho);
  return rho[1];
}

double WeightedProblem::cost() const { return impl_->cost(); }

WeightedProblem::Solution WeightedProblem::solve(int max_iterations, double cost_tolerance) {
  return impl_->solve(max_iterations, cost_tolerance);
}

}  // namespace cellmap
