#pragma once

#include <map>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// What a constraint leads to.
struct Neighbour {
  CellId cell;
  double length_m = 0;      ///< of the measured translation
  bool in_session = false;  ///< by an odometry or bidirectional constraint
};
/// The neighbours of every CELL that has some, both ways along each constraint.
using Adjacency = std::map<CellId, std::vector<Neighbour>>;

Adjacency adjacency_of(const PoseGraph& graph);

/// Length of the shortest path along constraints to every CELL that can be reached, itself
/// included (Dijkstra). O(constraints log CELLs).
std::map<CellId, double> path_lengths(const Adjacency& adjacency, CellId from);

}  // namespace cellmap
