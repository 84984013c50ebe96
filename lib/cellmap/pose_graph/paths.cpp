#include "cellmap/pose_graph/paths.hpp"

#include <queue>

namespace cellmap {

Adjacency adjacency_of(const PoseGraph& graph) {
  Adjacency adjacency;
  for (const Constraint& c : graph.constraints) {
    const double length = c.T_from_to.translation().norm();
    const bool in_session = c.kind != ConstraintKind::kLoop;
    adjacency[c.from].push_back({c.to, length, in_session});
    adjacency[c.to].push_back({c.from, length, in_session});
  }
  return adjacency;
}

std::map<CellId, double> path_lengths(const Adjacency& adjacency, CellId from) {
  std::map<CellId, double> length;
  using Entry = std::pair<double, CellId>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  open.push({0.0, from});
  while (!open.empty()) {
    const auto [metres, cell] = open.top();
    open.pop();
    if (!length.emplace(cell, metres).second) continue;
    const auto found = adjacency.find(cell);
    if (found == adjacency.end()) continue;
    for (const Neighbour& n : found->second) open.push({metres + n.length_m, n.cell});
  }
  return length;
}

}  // namespace cellmap
