#include "cellmap/pose_graph/edit.hpp"

#include <algorithm>
#include <numbers>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/constraint_residual.hpp"

namespace cellmap {
namespace {

template <typename Graph>
auto position(Graph& graph, ConstraintId id) {
  const auto found = std::find_if(graph.constraints.begin(), graph.constraints.end(),
                                  [&](const Constraint& c) { return c.id == id; });
  if (found == graph.constraints.end()) {
    throw Error(ErrorCode::kNotFound,
                "the pose graph has no constraint " + std::to_string(id.value));
  }
  return found;
}

}  // namespace

const Constraint& find_constraint(const PoseGraph& graph, ConstraintId id) {
  return *position(graph, id);
}

void erase_constraint(PoseGraph& graph, ConstraintId id) {
  graph.constraints.erase(position(graph, id));
  forget_rejections(graph);
}

void set_pinned(PoseGraph& graph, ConstraintId id, bool pinned) {
  position(graph, id)->pinned = pinned;
  forget_rejections(graph);
}

void forget_rejections(PoseGraph& graph) {
  for (Constraint& constraint : graph.constraints) constraint.weight = 1.0;
}

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::kTrusted:
      return "trusted";
    case Verdict::kPinned:
      return "pinned";
    case Verdict::kAccepted:
      return "accepted";
    case Verdict::kWeakened:
      return "weakened";
    case Verdict::kRejected:
      return "rejected";
  }
  return "unknown";
}

Verdict verdict(const Constraint& constraint) {
  if (constraint.pinned) return Verdict::kPinned;
  if (is_trusted(constraint)) return Verdict::kTrusted;
  if (constraint.weight == 0) return Verdict::kRejected;
  return constraint.weight == 1 ? Verdict::kAccepted : Verdict::kWeakened;
}

ConstraintReport explain(const PoseGraph& graph, ConstraintId id) {
  ConstraintReport report;
  report.constraint = find_constraint(graph, id);
  const Constraint& c = report.constraint;
  report.verdict = verdict(c);
  const auto from = graph.nodes.find(c.from), to = graph.nodes.find(c.to);
  if (from == graph.nodes.end() || to == graph.nodes.end()) {
    throw Error(ErrorCode::kNotFound,
                "constraint " + std::to_string(id.value) + " names a CELL that is not there");
  }
  const Pose T = from->second.inverse() * to->second;
  report.gap_m = (T.translation() - c.T_from_to.translation()).norm();
  report.gap_deg = angle_between_rad(T, c.T_from_to) * 180 / std::numbers::pi;
  report.chi2 = ConstraintResidual(c).error(from->second, to->second).squaredNorm();
  return report;
}

}  // namespace cellmap
