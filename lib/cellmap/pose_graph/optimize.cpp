#include <algorithm>
#include <cmath>
#include <vector>

#include "cellmap/pose_graph/chains.hpp"
#include "cellmap/pose_graph/components.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/pose_graph/start.hpp"
#include "cellmap/pose_graph/weighted_problem.hpp"

namespace cellmap {
namespace {

/// A loop longer than this many loss scales is stretched: it pulls so little that what it
/// contradicts may hold it open. By chance no true loop is so long at the solution.
constexpr double kStretchedScales = 2;

/// Relative decrease of the cost that ends a solution that need not be precise.
constexpr double kApproachTolerance = 1e-3;

/// Loops may come and go at the border of rejection; this often they may.
constexpr int kMostJudgements = 8;

/// By how much graduated non-convexity raises its control parameter, and how often at most.
constexpr double kGraduation = 1.4;
constexpr int kMostGraduations = 100;

bool has_moved(const Pose& before, const Pose& after) {
  return (before.translation() - after.translation()).norm() > kMovedTranslationM ||
         angle_between_rad(before, after) > kMovedRotationRad;
}

Pose normalised(Pose T) {
  T.linear() = Eigen::Quaterniond(T.linear()).normalized().toRotationMatrix();
  return T;
}

/// The weight of truncated least squares at squared residual s, smoothed by mu (Yang et al., 14).
double graduated_weight(double s, double c2, double mu) {
  if (s <= mu / (mu + 1) * c2) return 1;
  if (s >= (mu + 1) / mu * c2) return 0;
  return std::sqrt(c2 * mu * (mu + 1) / s) - mu;
}

class Optimisation {
 public:
  using Loss = WeightedProblem::Loss;

  Optimisation(PoseGraph& graph, const PoseGraphOptions& options)
      : graph_(graph),
        options_(options),
        is_robust_(options.loop_loss_scale > 0),
        c2_(options.loop_loss_scale * options.loop_loss_scale),
        stretched_(kStretchedScales * kStretchedScales * c2_),
        problem_(graph, options.loop_loss_scale, 1) {
    for (std::size_t i = 0; i < graph.constraints.size(); ++i) {
      if (!is_trusted(graph.constraints[i])) loops_.push_back(i);
    }
    weights_.assign(loops_.size(), 1.0);
  }

  PoseGraphSummary run() {
    PoseGraphSummary summary;
    summary.initial_cost = cost();
    recall_rejections();
    const bool is_new = is_robust_ && has_stretched_loop();
    choose_start(is_new);
    if (is_new && has_stretched_loop()) judge_anew();
    summary.converged = solve_and_judge();
    summary.iterations = steps_;
    summary.final_cost = cost();
    summary.moved = write_poses();
    summary.rejected = write_weights();
    return summary;
  }

 private:
  Loss final_loss() const { return is_robust_ ? Loss::kScaled : Loss::kNone; }

  /// Half the sum after the loss, whatever is rejected.
  double cost() {
    const std::vector<double> kept = weights_;
    set_weights(std::vector<double>(loops_.size(), 1.0));
    problem_.set_loss(final_loss());
    const double cost = problem_.cost();
    set_weights(kept);
    return cost;
  }

  void set_weights(const std::vector<double>& weights) {
    weights_ = weights;
    for (std::size_t k = 0; k < loops_.size(); ++k) problem_.set_weight(loops_[k], weights_[k]);
  }

  double chi2(std::size_t k) const { return problem_.chi2(loops_[k]); }

  bool solve(double tolerance) {
    const auto solution = problem_.solve(options_.max_iterations, tolerance);
    steps_ += solution.steps;
    return solution.converged;
  }

  void recall_rejections() {
    if (!is_robust_) return;
    std::vector<double> weights;
    for (const std::size_t i : loops_) {
      weights.push_back(graph_.constraints[i].weight == 0 ? 0.0 : 1.0);
    }
    set_weights(weights);
  }

  bool has_stretched_loop() const {
    for (std::size_t k = 0; k < loops_.size(); ++k) {
      if (weights_[k] > 0 && chi2(k) > stretched_) return true;
    }
    return false;
  }

  /// The poses of least cost, with a loss that does not hide a loop that is far off.
  void choose_start(bool place_chains) {
    place_chains &= has_chains(graph_);
    if (!place_chains && options_.start == GraphStart::kGiven) return;
    problem_.set_loss(is_robust_ ? Loss::kCauchy : Loss::kNone);
    std::vector<Pose> best = problem_.poses();
    double least = problem_.cost();
    const auto consider = [&](const std::map<CellId, Pose>& poses) {
      problem_.set_poses(poses);
      if (problem_.cost() < least) best = problem_.poses(), least = problem_.cost();
    };
    if (place_chains) {
      consider(chain_start(graph_, options_.least_joining_loops, options_.loop_loss_scale));
    }
    if (options_.start == GraphStart::kBest) {
      consider(spanning_tree_start(graph_));
      consider(chordal_start(graph_));
    }
    problem_.set_poses(best);
  }

  /// Brings all loops together by a pull that is bounded, rejected ones too.
  void judge_anew() {
    set_weights(std::vector<double>(loops_.size(), 1.0));
    problem_.set_loss(Loss::kCauchy);
    solve(kApproachTolerance);
    if (options_.robustness == LoopRobustness::kGraduated) graduate();
  }

  void graduate() {
    double longest = 0;
    for (std::size_t k = 0; k < loops_.size(); ++k) longest = std::max(longest, chi2(k));
    if (2 * longest <= c2_) return;
    problem_.set_loss(Loss::kNone);
    double mu = c2_ / (2 * longest - c2_);
    for (int i = 0; i < kMostGraduations; ++i) {
      std::vector<double> weights;
      for (std::size_t k = 0; k < loops_.size(); ++k) {
        weights.push_back(graduated_weight(chi2(k), c2_, mu));
      }
      set_weights(weights);
      solve(kApproachTolerance);
      const bool is_decided = std::all_of(weights.begin(), weights.end(),
                                          [](double weight) { return weight == 0 || weight == 1; });
      if (is_decided && mu > 1) break;
      mu *= kGraduation;
    }
  }

  /// Solves until no loop is rejected or comes back.
  bool solve_and_judge() {
    problem_.set_loss(final_loss());
    for (double& weight : weights_) weight = weight > 0 ? 1.0 : 0.0;
    set_weights(weights_);
    bool converged = solve(0);
    for (int i = 0; i < kMostJudgements && is_robust_ && judge(); ++i) converged = solve(0);
    return converged;
  }

  bool judge() {
    std::vector<double> judged = weights_;
    for (std::size_t k = 0; k < loops_.size(); ++k) {
      if (chi2(k) > stretched_) judged[k] = 0;
      if (chi2(k) <= c2_) judged[k] = 1;
    }
    if (judged == weights_) return false;
    set_weights(judged);
    return true;
  }

  /// What moved little keeps its bits, so that readers see no change. A component that only
  /// rejected loops tie to others goes back, as a rigid body, to where its lowest node was.
  std::size_t write_poses() {
    Components components(graph_.nodes.size());
    std::vector<CellId> ids;
    for (const auto& [id, T] : graph_.nodes) ids.push_back(id);
    const auto position = [&](CellId id) {
      return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
    };
    for (std::size_t i = 0; i < graph_.constraints.size(); ++i) {
      const Constraint& c = graph_.constraints[i];
      if (problem_.weight(i) > 0) components.join(position(c.from), position(c.to));
    }
    std::size_t moved = 0, i = 0;
    std::vector<Pose> back(ids.size());
    for (auto& [id, T] : graph_.nodes) {
      const Pose& T_found = problem_.poses()[i];
      const std::size_t lowest = components.lowest(i);
      if (lowest == i) back[i] = T * T_found.inverse();
      const bool stayed = back[lowest].matrix().isIdentity(1e-12);
      const Pose T_new = lowest == i ? T : stayed ? T_found : back[lowest] * T_found;
      if (has_moved(T, T_new)) T = normalised(T_new), ++moved;
      ++i;
    }
    return moved;
  }

  /// Returns how many are rejected.
  std::size_t write_weights() {
    problem_.set_poses(graph_.nodes);
    std::size_t rejected = 0;
    for (std::size_t i = 0; i < graph_.constraints.size(); ++i) {
      graph_.constraints[i].weight = problem_.weight(i);
      graph_.constraints[i].chi2 = problem_.chi2(i);
      rejected += graph_.constraints[i].weight == 0;
    }
    return rejected;
  }

  PoseGraph& graph_;
  const PoseGraphOptions& options_;
  const bool is_robust_;
  const double c2_, stretched_;
  WeightedProblem problem_;
  std::vector<std::size_t> loops_;  ///< constraints that are judged
  std::vector<double> weights_;     ///< of those
  int steps_ = 0;
};

}  // namespace

PoseGraphSummary optimize(PoseGraph& graph, const PoseGraphOptions& options) {
  options.validate();
  return Optimisation(graph, options).run();
}

}  // namespace cellmap
