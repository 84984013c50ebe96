#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// Hands out a CELL ready for registration; may load it. Never null.
using TargetProvider = std::function<std::shared_ptr<const RegistrationTarget>(CellId)>;

/// A guess that two CELLs see the same place.
struct LoopCandidate {
  CellId cell;
  Pose T_candidate_query = Pose::Identity();  ///< from the current poses
  double distance_m = 0;
};

/// A verified loop: the measurement that becomes a constraint.
struct LoopClosure {
  CellId from;  ///< the older CELL
  CellId to;    ///< the CELL that closed the loop
  RegistrationResult result;  ///< T_from_to
};

struct LoopOptions {
  std::size_t candidates = 10;      ///< the paper's n_loop: nearest CELLs that are looked at
  std::size_t exclude_latest = 10;  ///< the latest CELLs of the same session are no loops
  double max_distance_m = 30.0;     ///< farther CELLs are no candidates
  AcceptanceOptions acceptance;
  RegistrationOptions registration;
  // The owner of this room adds the yaw and translation seeds.

  void validate() const;
};

/// The nearest CELLs by current position (paper, Sec. III-D), nearest first.
std::vector<LoopCandidate> find_loop_candidates(const PoseGraph& graph, CellId query,
                                                const LoopOptions& options);

/// Registers the query's base scan to the candidate from the guess and, where that is uncertain, from
/// yaw and translation seeds around it; checks the answer in the reverse direction with the
/// candidate's reconstructed points. Nullopt where no seed passes.
std::optional<LoopClosure> verify_loop(const RegistrationTarget& candidate, const RegistrationTarget& query,
                                       const PointCloud& query_scan, const LoopCandidate& guess,
                                       CellId query_id, const LoopOptions& options);

/// All candidates of a CELL, each tried; every closure that passes. `query_scan` is the base scan, or
/// the CELL's reconstructed points where no scan was kept.
std::vector<LoopClosure> detect_loops(const PoseGraph& graph, CellId query, const PointCloud& query_scan,
                                      const TargetProvider& targets, const LoopOptions& options);

}  // namespace cellmap
