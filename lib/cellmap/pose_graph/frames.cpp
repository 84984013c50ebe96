#include "cellmap/pose_graph/frames.hpp"

#include <algorithm>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/components.hpp"

namespace cellmap {
namespace {

std::size_t position(const std::vector<CellId>& ids, CellId id) {
  const auto found = std::ranges::lower_bound(ids, id);
  if (found != ids.end() && *found == id) return static_cast<std::size_t>(found - ids.begin());
  throw Error(ErrorCode::kNotFound,
              "CELL " + std::to_string(id.value) + " is not in the pose graph");
}

}  // namespace

Frames::Frames(const PoseGraph& graph) {
  std::vector<CellId> ids;
  for (const auto& [id, pose] : graph.nodes) ids.push_back(id);
  Components components(ids.size());
  std::optional<std::size_t> aligned;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (graph.unaligned.contains(ids[i])) continue;
    if (aligned) components.join(*aligned, i);
    aligned = i;
  }
  for (const Constraint& c : graph.constraints) {
    components.join(position(ids, c.from), position(ids, c.to));
  }
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const std::size_t lowest = components.lowest(i);
    names_.emplace_hint(names_.end(), ids[i], ids[lowest]);
    count_ += lowest == i;
  }
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
