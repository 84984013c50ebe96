#include "cellmap/pose_graph/map_changes.hpp"

namespace cellmap {

std::map<ConstraintId, Judgement> judged_anew(std::span<const Constraint> before,
                                              std::span<const Constraint> after) {
  std::map<ConstraintId, Judgement> judged;
  auto old = before.begin();
  for (const Constraint& constraint : after) {
    if (constraint.id.value == 0) continue;
    while (old != before.end() && old->id < constraint.id) ++old;
    if (old == before.end()) break;
    if (old->id == constraint.id && !(judgement(*old) == judgement(constraint))) {
      judged.emplace_hint(judged.end(), constraint.id, judgement(constraint));
    }
  }
  return judged;
}

}  // namespace cellmap
