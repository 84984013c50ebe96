#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "cellmap/core/hash.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// What is known of a CELL of a map without touching its bytes.
struct CellRecord {
  CellId id;
  ContentHash hash;    ///< of the encoded CELL, in whatever bytes it is kept or sent
  Revision added = 0;  ///< revision that brought it, or last gave it another hash
  Revision moved = 0;  ///< revision that last changed its pose or hash
  Pose T_map_cell = Pose::Identity();
  std::string session;
  std::uint32_t sequence = 0;
  std::uint32_t planes = 0;
  std::uint64_t encoded_bytes = 0;
};

/// What an optimisation and a user made of a constraint: the part of it that changes.
struct Judgement {
  double weight = 1.0;  ///< Constraint::weight
  bool pinned = false;  ///< Constraint::pinned
  bool operator==(const Judgement&) const = default;
};
inline Judgement judgement(const Constraint& constraint) {
  return {constraint.weight, constraint.pinned};
}

/// The numbered constraints of `after` that `before` judges otherwise. Both in order of id; those
/// that only one has are left out. O(constraints).
std::map<ConstraintId, Judgement> judged_anew(std::span<const Constraint> before,
                                              std::span<const Constraint> after);

/// What happened to a map after a revision.
struct MapChanges {
  Revision since = 0, revision = 0;
  std::vector<CellRecord> added;                  ///< ascending id, with their current poses
  std::map<CellId, Pose> moved;                   ///< CELLs that were there before and moved
  std::vector<Constraint> added_constraints;      ///< and not removed since; ascending id
  std::vector<CellId> removed;                    ///< CELLs that are gone; ascending id
  std::vector<ConstraintId> removed_constraints;  ///< ascending id
  std::set<CellId> unaligned;                     ///< all that are not in the map frame now
  std::map<ConstraintId, Judgement> judged;       ///< constraints that were there, as judged now
};

}  // namespace cellmap
