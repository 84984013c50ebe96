#pragma once

#include <map>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// The parts of a map that no constraint ties to one another. A session starts as an island of its
/// own whose poses are in its odometry frame; what a robot sees twice joins islands
/// (map/junction.hpp). Poses of two islands are in two frames and must not be compared.
///
/// An island is named by the lowest id of its CELLs. The island of the map's lowest id defines the
/// map frame; the others are unaligned. A value; O((nodes + constraints) log nodes) to make.
class Islands {
 public:
  explicit Islands(const PoseGraph& graph);

  std::size_t count() const { return count_; }
  /// The island of a CELL of the graph. Throws Error{kNotFound} for another.
  CellId of(CellId cell) const;
  /// True for CELLs of the island that defines the map frame.
  bool is_aligned(CellId cell) const { return of(cell) == names_.begin()->second; }

  /// The CELLs of all islands but this, with their poses and without constraints.
  PoseGraph without(CellId island, const PoseGraph& graph) const;

 private:
  std::map<CellId, CellId> names_;  ///< of every CELL
  std::size_t count_ = 0;
};

}  // namespace cellmap
