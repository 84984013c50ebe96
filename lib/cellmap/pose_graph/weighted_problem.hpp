#pragma once

#include <memory>
#include <vector>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// A pose graph as one Ceres problem that is solved several times: poses, weights and the loss
/// change from one solution to the next, the structure stays. Constraints and nodes are named by
/// their position in the graph. In every connected component the lowest node stays.
class WeightedProblem {
 public:
  /// What becomes of the squared residual s of a loop that is not pinned.
  enum class Loss {
    kNone,    ///< s
    kCauchy,  ///< a pull that is bounded but never ends
    kScaled,  ///< s up to c^2; beyond it a weight that falls with the fourth power of the residual
  };

  /// Throws Error{kInvalidArgument} for a pose or constraint that is not valid.
  WeightedProblem(const PoseGraph& graph, double loss_scale, int threads);
  ~WeightedProblem();
  WeightedProblem(const WeightedProblem&) = delete;
  WeightedProblem& operator=(const WeightedProblem&) = delete;

  const std::vector<Pose>& poses() const;
  void set_poses(const std::map<CellId, Pose>& poses);
  void set_poses(const std::vector<Pose>& poses);
  void set_loss(Loss loss);
  /// Beside the loss; 0: as if it were not there.
  void set_weight(std::size_t constraint, double weight);

  /// Squared length of a constraint's whitened residual, without loss and weight.
  double chi2(std::size_t constraint) const;
  double weight(std::size_t constraint) const;  ///< of the loss, times the one that was set
  /// Half the sum of weight * loss(chi2).
  double cost() const;

  struct Solution {
    bool converged = false;
    int steps = 0;
  };
  /// Ends when the cost falls by less than `cost_tolerance` of itself, or when the next step is
  /// expected to move no node by more than half of what counts as moved.
  Solution solve(int max_iterations, double cost_tolerance);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// What counts as moved: readers are told.
constexpr double kMovedTranslationM = 1e-4;
constexpr double kMovedRotationRad = 1e-6;

}  // namespace cellmap
