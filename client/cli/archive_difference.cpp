#include "client/cli/archive_difference.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace cellmap::cli {
namespace {

client::Json ids_json(const std::vector<CellId>& ids) {
  client::Json json = client::Json::array();
  for (const CellId id : ids) json.push_back(id.value);
  return json;
}

}  // namespace

ArchiveDifference difference(ArchiveReader& a, ArchiveReader& b) {
  ArchiveDifference found;
  std::map<CellId, ContentHash> before;
  for (const ArchivedCell& cell : a.cells()) before.emplace(cell.id, cell.hash);
  for (const ArchivedCell& cell : b.cells()) {
    const auto old = before.find(cell.id);
    if (old == before.end()) {
      found.added.push_back(cell.id);
      continue;
    }
    if (old->second == cell.hash) {
      ++found.alike;
    } else {
      found.changed.push_back(cell.id);
    }
    before.erase(old);
    const Pose T_a_b =
        a.pose_graph().nodes.at(cell.id).inverse() * b.pose_graph().nodes.at(cell.id);
    const double metres = T_a_b.translation().norm();
    const double turn_rad = Eigen::AngleAxisd(T_a_b.linear()).angle();
    found.moved += metres > 2e-4 || turn_rad > 2e-6;  // more than a pose update rounds
    found.farthest_m = std::max(found.farthest_m, metres);
    found.largest_turn_rad = std::max(found.largest_turn_rad, turn_rad);
  }
  for (const auto& [id, hash] : before) found.removed.push_back(id);
  found.constraints = {a.pose_graph().constraints.size(), b.pose_graph().constraints.size()};
  found.revisions = {a.pose_graph().revision, b.pose_graph().revision};
  return found;
}

client::Json to_json(const ArchiveDifference& found) {
  return {{"alike", found.alike},
          {"added", ids_json(found.added)},
          {"removed", ids_json(found.removed)},
          {"changed", ids_json(found.changed)},
          {"moved", found.moved},
          {"farthest_m", found.farthest_m},
          {"largest_turn_rad", found.largest_turn_rad},
          {"constraints", found.constraints},
          {"revisions", found.revisions}};
}

}  // namespace cellmap::cli
