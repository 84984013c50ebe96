#pragma once

#include <map>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// The parts of a map whose poses are in one frame. All aligned CELLs make one island, that of the
/// map frame. A further session starts unaligned, as an island of its own in its odometry frame;
/// what it sees of another island joins the two (map/junction.hpp). Poses of two islands must not
/// be compared.
///
/// An island is named by the lowest id of its CELLs. A value; O((nodes + constraints) log nodes) to
/// make.
class Frames {
 public:
  explicit Frames(const PoseGraph& graph);

  std::size_t count() const { return count_; }
  /// The island of a CELL of the graph. Throws Error{kNotFound} for another.
  CellId of(CellId cell) const;
  std::vector<CellId> cells(CellId island) const;  ///< ascending; O(nodes)
  /// The CELLs of all islands but this, with their poses and without constraints.
  PoseGraph without(CellId island, const PoseGraph& graph) const;

 private:
  std::map<CellId, CellId> names_;  ///< of every CELL
  std::size_t count_ = 0;
};

}  // namespace cellmap
