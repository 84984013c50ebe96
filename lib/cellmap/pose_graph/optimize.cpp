#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/pose_graph/block_cholesky.hpp"
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

constexpr std::size_t kConstraintsATask = 256;

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

/// Cauchy's loss of a squared residual s, c^2 log(1 + s / c^2), with its derivatives by s.
/// Without a scale: s itself.
struct Loss {
  double value, slope, curvature;

  Loss(double s, double scale) : value(s), slope(1), curvature(0) {
    if (!(scale > 0)) return;
    const double c2 = scale * scale;
    value = c2 * std::log1p(s / c2);
    slope = 1.0 / (1.0 + s / c2);
    curvature = -slope * slope / c2;
  }
};

using Poses = std::vector<Pose>;

class Problem {
 public:
  Problem(const PoseGraph& graph, const PoseGraphOptions& options) : options_(options) {
    for (const auto& [id, T] : graph.nodes) {
      if (!is_rigid(T)) {
        throw Error(ErrorCode::kInvalidArgument,
                    "CELL " + std::to_string(id.value) + " has a pose that is not rigid");
      }
      ids_.push_back(id);
    }
    for (const Constraint& constraint : graph.constraints) add(constraint);
    number_unknowns();
  }

  bool empty() const { return terms_.empty(); }
  std::size_t unknowns() const { return unknowns_; }
  std::vector<BlockCholesky::Pair> coupled_unknowns() const;

  double cost(const Poses& poses) const;

  /// `gradient` and `fill` give the derivatives of the cost at these poses by right perturbations
  /// of the unknowns.
  void linearise(const Poses& poses);
  Eigen::VectorXd gradient() const;
  void fill(double curvature_share, BlockCholesky& hessian) const;

  /// poses * exp(step).
  Poses moved(const Poses& poses, const Eigen::VectorXd& step) const;

 private:
  static constexpr std::size_t kFixed = std::numeric_limits<std::size_t>::max();

  struct Term {
    ConstraintResidual residual;
    std::size_t from, to;  ///< nodes
    double loss_scale;
  };

  void add(const Constraint& constraint) {
    validate(constraint);
    const bool robust = constraint.kind == ConstraintKind::kLoop;
    terms_.push_back({ConstraintResidual(constraint), position(constraint.from),
                      position(constraint.to), robust ? options_.loop_loss_scale : 0.0});
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

  /// The gauge: every component's lowest node is none.
  void number_unknowns() {
    Components components(ids_.size());
    for (const Term& term : terms_) components.join(term.from, term.to);
    unknown_.assign(ids_.size(), kFixed);
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (components.lowest(i) != i) unknown_[i] = unknowns_++;
    }
  }

  const PoseGraphOptions& options_;
  std::vector<CellId> ids_;  // ascending
  std::vector<Term> terms_;
  std::vector<ConstraintResidual::Linear> linear_;  // of each term
  std::vector<std::size_t> unknown_;                // number of a node's unknown, or kFixed
  std::size_t unknowns_ = 0;
};

std::vector<BlockCholesky::Pair> Problem::coupled_unknowns() const {
  std::vector<BlockCholesky::Pair> pairs;
  for (const Term& term : terms_) {
    if (unknown_[term.from] != kFixed && unknown_[term.to] != kFixed) {
      pairs.emplace_back(unknown_[term.from], unknown_[term.to]);
    }
  }
  return pairs;
}

double Problem::cost(const Poses& poses) const {
  double sum = 0;
  for (const Term& term : terms_) {
    const Tangent e = term.residual.error(poses[term.from], poses[term.to]);
    sum += Loss(e.dot(term.residual.weight() * e), term.loss_scale).value;
  }
  return 0.5 * sum;
}

void Problem::linearise(const Poses& poses) {
  linear_.resize(terms_.size());
  parallel_for(terms_.size(), kConstraintsATask, options_.threads,
               [&](std::size_t begin, std::size_t end) {
                 for (std::size_t i = begin; i < end; ++i) {
                   const Term& term = terms_[i];
                   linear_[i] = term.residual.linearise(poses[term.from], poses[term.to]);
                 }
               });
}

Eigen::VectorXd Problem::gradient() const {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(6 * static_cast<Eigen::Index>(unknowns_));
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    const Term& term = terms_[i];
    const ConstraintResidual::Linear& linear = linear_[i];
    const Tangent weighted = term.residual.weight() * linear.error;
    const double slope = Loss(linear.error.dot(weighted), term.loss_scale).slope;
    const auto add = [&](std::size_t node, const Matrix6d& jacobian) {
      if (unknown_[node] == kFixed) return;
      sum.segment<6>(6 * static_cast<Eigen::Index>(unknown_[node])) +=
          slope * (jacobian.transpose() * weighted);
    };
    add(term.from, linear.by_from);
    add(term.to, linear.by_to);
  }
  return sum;
}

void Problem::fill(double curvature_share, BlockCholesky& hessian) const {
  hessian.set_zero();
  std::size_t pair = 0;
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    const Term& term = terms_[i];
    const ConstraintResidual::Linear& linear = linear_[i];
    const Matrix6d& W = term.residual.weight();
    const Tangent weighted = W * linear.error;
    const Loss loss(linear.error.dot(weighted), term.loss_scale);
    Matrix6d B = loss.slope * W;
    if (curvature_share * loss.curvature != 0) {
      B += 2 * curvature_share * loss.curvature * weighted * weighted.transpose();
    }
    const Matrix6d B_to = B * linear.by_to;
    const std::size_t from = unknown_[term.from], to = unknown_[term.to];
    if (to != kFixed) hessian.add_diagonal(to, linear.by_to.transpose() * B_to);
    if (from == kFixed) continue;
    hessian.add_diagonal(from, linear.by_from.transpose() * B * linear.by_from);
    if (to != kFixed) hessian.add_pair(pair++, linear.by_from.transpose() * B_to);
  }
}

Poses Problem::moved(const Poses& poses, const Eigen::VectorXd& step) const {
  Poses result = poses;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (unknown_[i] == kFixed) continue;
    result[i] = poses[i] * exp(step.segment<6>(6 * static_cast<Eigen::Index>(unknown_[i])));
  }
  return result;
}

bool is_last(const Eigen::VectorXd& step) {
  for (Eigen::Index i = 0; i < step.size(); i += 6) {
    if (step.segment<3>(i).norm() > kLastStepM || step.segment<3>(i + 3).norm() > kLastStepRad) {
      return false;
    }
  }
  return true;
}

/// How the next step is held back where the plain Newton step does not lower the cost.
/// First the loss's curvature is left out bit by bit: with all of it a step ends quadratically, but
/// losses of large residuals curve downwards, so that the Hessian may not be positive definite;
/// without it the step is that of iteratively reweighted least squares, which always descends, but
/// ends slowly. Then the step is damped (Levenberg-Marquardt).
class Caution {
 public:
  double curvature_share() const { return 1 - left_out_; }
  double damping() const { return damping_; }
  bool is_exhausted() const { return damping_ > kMostDamping; }

  void less() {
    if (std::exchange(just_raised_, false)) return;  // what has just failed would fail again
    left_out_ = left_out_ > kLeastLeftOut / 4 ? left_out_ / 2 : 0;
    damping_ = damping_ > kFirstDamping ? damping_ / 10 : 0;
  }

  void more() {
    just_raised_ = true;
    if (left_out_ < 1) {
      left_out_ = std::clamp(2 * left_out_, kLeastLeftOut, 1.0);
    } else {
      damping_ = std::max(10 * damping_, kFirstDamping);
    }
  }

 private:
  static constexpr double kLeastLeftOut = 0.2;
  static constexpr double kFirstDamping = 1e-6, kMostDamping = 1e12;
  double left_out_ = 0, damping_ = 0;
  bool just_raised_ = false;
};

PoseGraphSummary minimise(Problem& problem, Poses& poses, int max_iterations) {
  BlockCholesky hessian(problem.unknowns(), problem.coupled_unknowns());
  PoseGraphSummary summary;
  summary.initial_cost = summary.final_cost = problem.cost(poses);
  problem.linearise(poses);
  Caution caution;
  while (summary.iterations < max_iterations && !summary.converged && !caution.is_exhausted()) {
    ++summary.iterations;
    problem.fill(caution.curvature_share(), hessian);
    if (!hessian.factorise(caution.damping())) {
      caution.more();
      continue;
    }
    const Eigen::VectorXd step = hessian.solve(-problem.gradient());
    Poses next = problem.moved(poses, step);
    const double cost = problem.cost(next);
    // Rounding may hide that so small a step descends.
    summary.converged = std::isfinite(cost) && caution.damping() == 0 && is_last(step);
    if (cost < summary.final_cost || summary.converged) {
      poses = std::move(next);
      summary.final_cost = cost;
      if (!summary.converged) problem.linearise(poses);
      caution.less();
    } else {
      caution.more();
    }
  }
  return summary;
}

bool has_moved(const Pose& before, const Pose& after) {
  return (before.translation() - after.translation()).norm() > kMovedTranslationM ||
         angle_between_rad(before, after) > kMovedRotationRad;
}

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
  if (problem.empty()) return {.converged = true};
  Poses poses;
  for (const auto& [id, T] : graph.nodes) poses.push_back(T);
  PoseGraphSummary summary = minimise(problem, poses, options.max_iterations);
  auto optimised = poses.cbegin();
  for (auto& [id, T] : graph.nodes) {
    // What moved less keeps its bits, so that readers see no change.
    const Pose& T_optimised = *optimised++;
    if (!has_moved(T, T_optimised)) continue;
    T = normalised(T_optimised);
    ++summary.moved;
  }
  return summary;
}

}  // namespace cellmap
