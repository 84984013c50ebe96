#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/place/pose_search.hpp"
#include "cellmap/place/structure_score.hpp"
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
  /// Metres along the graph between the two, which is what drift grows with; infinite where nothing
  /// ties them. 0: the guess is certain.
  double path_m = 0;
};

/// A verified loop: the measurement that becomes a constraint.
struct LoopClosure {
  CellId from;                ///< the older CELL
  CellId to;                  ///< the CELL that closed the loop
  RegistrationResult result;  ///< T_from_to
};

/// Which closures are believed.
enum class LoopAcceptance {
  kScores,  ///< several scores agree, the closure lies where drift allows, the reverse agrees
  kPaper,   ///< the paper's, for comparison: inliers over all points >= 0.2 and nothing else
};
constexpr double kPaperInlierRatio = 0.2;

/// "scores" or "paper", as in the API and on the command line; nothing for another name.
std::string to_string(LoopAcceptance acceptance);
std::optional<LoopAcceptance> loop_acceptance_from(std::string_view name);

struct LoopOptions {
  LoopAcceptance accept = LoopAcceptance::kScores;
  std::size_t candidates = 10;  ///< the paper's n_loop: nearest CELLs that are looked at
  /// So many closures of a CELL are enough: candidates farther than theirs are left, which see the
  /// same place again.
  std::size_t closures = 4;
  /// CELLs at most this many neighbours away in the session are no loops (the paper's latest
  /// n_loop).
  std::size_t exclude_latest = 10;
  double max_distance_m = 30.0;  ///< farther CELLs are no candidates
  /// How far the guess may be off: these many metres and degrees a metre of path between the two
  /// CELLs, beside 2 m and 5 deg. A closure that would need more is refused.
  double drift_m_per_m = 0.05;
  double drift_deg_per_m = 0.02;
  /// Best alignments of the two places' images that are tried beside the guess where the guess may
  /// be off by more than a registration's reach (1 m, 5 deg); about 4 ms each.
  std::size_t seeds = 8;
  /// The candidate's points registered to the query's CELL must find the same pose within these.
  double max_reverse_difference_m = 0.5;
  double max_reverse_difference_deg = 2.0;
  std::size_t search_points = 3'000;  ///< as in PoseSearchOptions
  std::size_t refine_points = 30'000;
  AcceptanceOptions acceptance = default_place_acceptance();
  StructureAcceptance structure;
  RegistrationOptions registration = default_place_registration();

  void validate() const;
  PoseSearchOptions search() const;
};

/// The nearest CELLs of the query's island by current position (paper, Sec. III-D), nearest first.
/// Throws Error{kNotFound} where the graph has no such CELL.
std::vector<LoopCandidate> find_loop_candidates(const PoseGraph& graph, CellId query,
                                                const LoopOptions& options);

/// Registers the query's base scan to the candidate from the guess and, where that is uncertain,
/// from yaw and translation seeds around it; checks the answer in the reverse direction with the
/// candidate's reconstructed points. Nullopt where no seed passes.
std::optional<LoopClosure> verify_loop(const RegistrationTarget& candidate,
                                       const RegistrationTarget& query,
                                       const PointCloud& query_scan, const LoopCandidate& guess,
                                       CellId query_id, const LoopOptions& options);

/// Candidates of a CELL, nearest first, until `closures` of them pass; those. `query_scan` is the
/// base scan, or the CELL's reconstructed points where no scan was kept. Deterministic.
std::vector<LoopClosure> detect_loops(const PoseGraph& graph, CellId query,
                                      const PointCloud& query_scan, const TargetProvider& targets,
                                      const LoopOptions& options);

/// The constraint of a closure; its information is held down by what registration does not know of
/// its own errors (`realistic_information`).
Constraint to_constraint(const LoopClosure& closure, ConstraintOrigin origin);

}  // namespace cellmap
