#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

enum class ConstraintKind : std::uint8_t {
  kOdometry = 1,       ///< neighbours in one session, as the odometry gave it (registration failed)
  kBidirectional = 2,  ///< neighbours in one session, refined by bidirectional registration
  kLoop = 3,           ///< a verified loop closure
};
std::string_view to_string(ConstraintKind kind);  ///< "odometry", "bidirectional", "loop"

/// Who measured a constraint.
enum class ConstraintOrigin : std::uint8_t {
  kMapper = 1,     ///< found while mapping
  kDetection = 2,  ///< asked for over the API
  kUser = 3,       ///< measured elsewhere and posted
};
std::string_view to_string(ConstraintOrigin origin);  ///< "mapper", "detection", "user"

/// A measured relative pose of two CELLs.
struct Constraint {
  ConstraintId id;  ///< 0 until a store has numbered it
  CellId from, to;
  Pose T_from_to = Pose::Identity();
  /// For the left perturbation exp(xi) * T_from_to, order (translation, rotation).
  Matrix6d information = Matrix6d::Identity();
  ConstraintKind kind = ConstraintKind::kOdometry;
  ConstraintOrigin origin = ConstraintOrigin::kMapper;
  RegistrationScores scores;  ///< zero where nothing was registered

  /// Held for certain by a user: never loses weight.
  bool pinned = false;
  /// What the last `optimize` left of it, from 0 (rejected) to 1 (counts in full).
  double weight = 1.0;
  /// Squared length of its whitened residual at the poses of the last `optimize`; 0 before.
  double chi2 = 0.0;
};

/// Constraints that are never rejected: those of neighbours, and pinned loops.
inline bool is_trusted(const Constraint& constraint) {
  return constraint.kind != ConstraintKind::kLoop || constraint.pinned;
}

/// Throws Error{kInvalidArgument}: from == to, a pose that is not rigid, an information matrix that
/// is not finite, symmetric and positive semi-definite with a positive trace.
void validate(const Constraint& constraint);

/// Current poses of the CELLs of a map and what is known between them. A value.
struct PoseGraph {
  Revision revision = 0;
  std::map<CellId, Pose> nodes;  ///< T_map_cell
  /// CELLs whose pose is not in the map frame yet but in that of their island
  /// (pose_graph/frames.hpp).
  std::set<CellId> unaligned;
  std::vector<Constraint> constraints;  ///< in order of id
  /// The next CELL gets this id or a higher one: those of removed CELLs are not given again.
  CellId next_cell{1};

  CellId new_cell_id() const {
    return nodes.empty() ? next_cell : std::max(next_cell, CellId{nodes.rbegin()->first.value + 1});
  }
};

/// Where an optimisation starts.
enum class GraphStart : std::uint8_t {
  kGiven,  ///< from the nodes' poses
  kBest,   ///< from those, a spanning tree or the chordal start (`start.hpp`): what costs least
};

/// How loops that contradict the others are found. Both end with weights that are exactly 0 for
/// what is rejected.
enum class LoopRobustness : std::uint8_t {
  kApproach,   ///< a bounded pull (Cauchy), then dynamic covariance scaling; the better one so far
  kGraduated,  ///< a bounded pull, then truncated least squares by graduated non-convexity (Yang
               ///< et al., RA-L 2020); 3 to 10 times as slow, for comparison
};

struct PoseGraphOptions {
  int max_iterations = 100;  ///< steps of each of the solutions that follow one another
  GraphStart start = GraphStart::kGiven;
  LoopRobustness robustness = LoopRobustness::kApproach;
  /// Loops whose whitened residual is longer than this many sigmas lose weight, with its fourth
  /// power; those longer than twice as many are rejected; shorter ones count in full. True loops
  /// exceed 4 in one case of a hundred (chi-square of six degrees of freedom). 0: all count in
  /// full.
  double loop_loss_scale = 4.0;
  /// A session that only loops tie to the others is placed by the loops that agree with one
  /// another (`chains.hpp`); fewer than this many leave it where it is.
  std::size_t least_joining_loops = 1;
  /// 0: all. The poses do not depend on it; at present one is used, because nine tenths of the time
  /// are a factorisation that has one thread.
  int threads = 1;

  void validate() const;
};

struct PoseGraphSummary {
  bool converged = false;
  int iterations = 0;
  double initial_cost = 0;  ///< half the sum of squared whitened residuals, after the loss
  double final_cost = 0;
  std::size_t moved = 0;     ///< nodes whose pose changed by more than 0.1 mm or 1e-6 rad
  std::size_t rejected = 0;  ///< loops of weight 0
};

/// Moves the nodes to the maximum-likelihood poses, starting from where they are, and writes each
/// constraint's `weight` and `chi2`; nothing else changes. Residual of a constraint: the error of
/// the position in the axes of `from` and twice the vector part of the rotation error's quaternion,
/// whitened (`constraint_residual.hpp`). Gauge: in every component that weights above 0 connect,
/// the node with the lowest id keeps its pose exactly. Ends when the steps to come would move no
/// node by 0.05 mm or 5e-7 rad. Deterministic. Throws Error{kInvalidArgument} where a constraint
/// names a node that is not there.
///
/// Ceres' Levenberg-Marquardt with analytic derivatives and a trust region so large that its steps
/// are Gauss-Newton's. Where a loop that is not rejected already is stretched beyond twice
/// `loop_loss_scale`, all are judged anew. Steps with Cauchy's loss come first: their pull on a
/// loop is bounded but never ends, so that a true loop after a long drift closes and a false one
/// yields to what contradicts it, before a loss is applied that forgets false ones (dynamic
/// covariance scaling). Loops that are stretched at its solution are rejected, and come back when a
/// later solution fulfils them within `loop_loss_scale`. So wrong closures cost time once; after
/// that each solution takes a step or two. On KITTI 00 and 05 with up to 80 % false closures none
/// is accepted and the trajectory error is that without them (`tests/real_data/evaluate.py
/// backend`). KITTI 00's graph (578 nodes, 306 loops) takes about 30 ms from odometry and 12 ms
/// after one new loop; a step takes 3 ms.
PoseGraphSummary optimize(PoseGraph& graph, const PoseGraphOptions& options = {});

/// g2o text: VERTEX_SE3:QUAT and EDGE_SE3:QUAT (information reordered to g2o's right perturbation).
std::string to_g2o(const PoseGraph& graph);

/// What a g2o file's information matrix belongs to.
enum class G2oInformation {
  kRightPerturbation,  ///< g2o's own: the error of T_from_to * exp(xi)
  kCeresExample,       ///< as the example that comes with Ceres takes it, to compare costs: errors
                       ///< in the axes of `from`, whitened by L (not L^T) of L * L^T
};

/// Inverse of `to_g2o`. Planar records (VERTEX_SE2, EDGE_SE2) become poses in the plane z = 0 with
/// what the plane leaves open as certain as the rest. A file without vertices gets poses along a
/// spanning tree, the lowest id at the origin. Kinds are odometry for consecutive ids, else loop;
/// ids count the edges from 1. The text is not trusted: throws Error{kCorruptData} naming the line
/// for anything not understood, coordinates beyond 1e8 m, other kinds of vertex or edge, vertices
/// that are missing or there twice, more than 5 million records.
PoseGraph pose_graph_from_g2o(std::string_view text,
                              G2oInformation meaning = G2oInformation::kRightPerturbation);

}  // namespace cellmap
