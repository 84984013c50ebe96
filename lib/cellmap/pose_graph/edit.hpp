#pragma once

#include <string_view>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// Changing a pose graph by hand and asking why it is as it is. `optimize` afterwards moves the
/// poses. What names a constraint throws Error{kNotFound} where the graph does not have it.

const Constraint& find_constraint(const PoseGraph& graph, ConstraintId id);

/// What the constraint may have had rejected is judged again.
void erase_constraint(PoseGraph& graph, ConstraintId id);

/// A pinned loop counts in full from then on; once unpinned it is judged like any other. What was
/// rejected is judged again.
void set_pinned(PoseGraph& graph, ConstraintId id, bool pinned);

/// Lets the next `optimize` judge all loops anew.
void forget_rejections(PoseGraph& graph);

/// What the last `optimize` made of a constraint.
enum class Verdict : std::uint8_t {
  kTrusted,   ///< ties neighbours: not judged
  kPinned,    ///< held by a user: not judged
  kAccepted,  ///< a loop that counts in full
  kWeakened,  ///< a loop that counts in part: longer than `loop_loss_scale`
  kRejected,  ///< a loop that does not count
};
std::string_view to_string(Verdict verdict);  ///< "trusted", "pinned", ...
Verdict verdict(const Constraint& constraint);

/// A constraint with its evidence (kind, origin, scores, information), its weight and chi-square,
/// and how it stands at the poses of now.
struct ConstraintReport {
  Constraint constraint;
  Verdict verdict = Verdict::kTrusted;
  double gap_m = 0;    ///< between the measured and the present position
  double gap_deg = 0;  ///< and rotation
  double chi2 = 0;     ///< squared whitened residual, at the poses of now
};
ConstraintReport explain(const PoseGraph& graph, ConstraintId id);

}  // namespace cellmap
