#include "cellmap/pose_graph/frames.hpp"

#include <algorithm>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// The root of a CELL in a forest in which each CELL points to one of a lower id or to itself;
/// shortens the way for the next one who asks.
CellId root(std::map<CellId, CellId>& parents, CellId cell) {
  CellId& parent = parents.at(cell);
  while (parents.at(parent) != parent) parent = parents.at(parent);
  return parent;
}

}  // namespace

Frames::Frames(const PoseGraph& graph) {
  for (const auto& [id, pose] : graph.nodes) names_.emplace_hint(names_.end(), id, id);
  count_ = names_.size();
  const auto unite = [&](CellId one, CellId other) {
    const CellId a = root(names_, one), b = root(names_, other);
    if (a == b) return;
    names_[std::max(a, b)] = std::min(a, b);
    --count_;
  };
  std::optional<CellId> aligned;
  for (const auto& [id, pose] : graph.nodes) {
    if (graph.unaligned.contains(id)) continue;
    if (aligned) unite(*aligned, id);
    aligned = id;
  }
  for (const Constraint& constraint : graph.constraints) unite(constraint.from, constraint.to);
  for (auto& [id, name] : names_) name = names_.at(name);  // lower ids are done already
}

CellId Frames::of(CellId cell) const {
  const auto found = names_.find(cell);
  if (found == names_.end()) {
    throw Error(ErrorCode::kNotFound,
                "CELL " + std::to_string(cell.value) + " is not in the pose graph");
  }
  return found->second;
}

std::vector<CellId> Frames::cells(CellId island) const {
  std::vector<CellId> cells;
  for (const auto& [id, name] : names_) {
    if (name == island) cells.push_back(id);
  }
  return cells;
}

PoseGraph Frames::without(CellId island, const PoseGraph& graph) const {
  PoseGraph rest;
  rest.revision = graph.revision;
  for (const auto& [id, pose] : graph.nodes) {
    if (of(id) != island) rest.nodes.emplace_hint(rest.nodes.end(), id, pose);
  }
  return rest;
}

}  // namespace cellmap
