#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/pose_graph/start.hpp"
#include "cellmap/pose_graph/weighted_problem.hpp"

namespace cellmap {
namespace {

/// A loop longer than this many loss scales is stretched: it pulls so little that what it
/// contradicts may hold it open. By chance no true loop is so long at the solution.
constexpr double kStretchedScales = 2;

/// Relative decrease of the cost that ends the approach; the solution need not be precise.
constexpr double kApproachTolerance = 1e-3;

bool has_stretched_loop(const PoseGraph& graph, const WeightedProblem& problem, double scale) {
  const double limit = std::pow(kStretchedScales * scale, 2);
  for (std::size_t i = 0; i < graph.constraints.size() && limit > 0; ++i) {
    if (!is_trusted(graph.constraints[i]) && problem.chi2(i) > limit) return true;
  }
  return false;
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
  WeightedProblem problem(graph, options.loop_loss_scale, 1);
  const bool is_robust = options.loop_loss_scale > 0;
  const auto final_loss = is_robust ? WeightedProblem::Loss::kScaled : WeightedProblem::Loss::kNone;
  problem.set_loss(final_loss);
  PoseGraphSummary summary;
  summary.initial_cost = problem.cost();
  if (options.start == GraphStart::kBest) {
    const std::vector<Pose> given = problem.poses();
    problem.set_poses(chordal_start(graph));
    if (!(problem.cost() < summary.initial_cost)) problem.set_poses(given);
  }
  if (is_robust && has_stretched_loop(graph, problem, options.loop_loss_scale)) {
    problem.set_loss(WeightedProblem::Loss::kCauchy);
    summary.iterations = problem.solve(options.max_iterations, kApproachTolerance).steps;
    problem.set_loss(final_loss);
  }
  const auto solved = problem.solve(options.max_iterations - summary.iterations, 0);
  summary.iterations += solved.steps;
  summary.final_cost = problem.cost();
  summary.converged = solved.converged;
  auto optimised = problem.poses().cbegin();
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
