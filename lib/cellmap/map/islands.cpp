#include "cellmap/map/islands.hpp"

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

Islands::Islands(const PoseGraph& graph) {
  for (const auto& [id, pose] : graph.nodes) names_.emplace_hint(names_.end(), id, id);
  count_ = names_.size();
  for (const Constraint& constraint : graph.constraints) {
    const CellId a = root(names_, constraint.from), b = root(names_, constraint.to);
    if (a == b) continue;
    names_[std::max(a, b)] = std::min(a, b);
    --count_;
  }
  for (auto& [id, name] : names_) name = names_.at(name);  // lower ids are done already
}

CellId Islands::of(CellId cell) const {
  const auto found = names_.find(cell);
  if (found == names_.end()) {
    throw Error(ErrorCode::kNotFound,
                "CELL " + std::to_string(cell.value) + " is not in the pose graph");
  }
  return found->second;
}

PoseGraph Islands::without(CellId island, const PoseGraph& graph) const {
  PoseGraph rest;
  rest.revision = graph.revision;
  for (const auto& [id, pose] : graph.nodes) {
    if (of(id) != island) rest.nodes.emplace_hint(rest.nodes.end(), id, pose);
  }
  return rest;
}

}  // namespace cellmap
