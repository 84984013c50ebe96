#include "client/cli/offline_diff.hpp"

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>

namespace cellmap::cli {
namespace {

/// The CELLs of a map with their poses of one revision.
struct Snapshot {
  std::map<CellId, CellRecord> records;
  PoseGraph graph;

  std::vector<PlacedCell> cells_of(const std::string& session, const DiffRequest& request) const {
    std::vector<PlacedCell> cells;
    bool known = false;
    for (const auto& [id, record] : records) {
      if (record.session != session || !graph.nodes.contains(id)) continue;
      known = true;
      if (graph.unaligned.contains(id)) {
        throw Error(ErrorCode::kConflict,
                    "session '" + session +
                        "' is not in the map frame yet, so it cannot be compared; it joins when it "
                        "sees what another session saw, or by 'cellmap loops add'");
      }
      const Pose& T_map_cell = graph.nodes.at(id);
      const bool is_near =
          !request.near || (T_map_cell.translation() - *request.near).norm() <= request.radius_m;
      if (is_near) cells.push_back({id, T_map_cell});
    }
    if (known) return cells;
    throw Error(ErrorCode::kNotFound, "the map has no CELLs of a session '" + session + "'");
  }
};

}  // namespace

MapDiff diff_offline(MapReader& reader, const std::string& map, const DiffRequest& request,
                     int threads, const std::stop_token& stop) {
  const auto begun = std::chrono::steady_clock::now();
  if (request.sessions[0] == request.sessions[1]) {
    throw Error(ErrorCode::kInvalidArgument, "name two different sessions, the earlier one first");
  }
  const auto lattice = std::make_shared<const Lattice>(reader.map(map).lattice);
  Snapshot snapshot;
  snapshot.graph = reader.pose_graph(map);
  for (CellRecord& record : reader.all_cells(map)) {
    const CellId id = record.id;
    snapshot.records.emplace(id, std::move(record));
  }
  const auto earlier = snapshot.cells_of(request.sessions[0], request);
  const auto later = snapshot.cells_of(request.sessions[1], request);
  const TargetProvider targets = [&](CellId id) {
    return std::make_shared<const RegistrationTarget>(
        std::make_shared<const Cell>(decode_cell(reader.cell(map, snapshot.records.at(id)).bytes)),
        lattice);
  };
  DiffOptions options;
  options.threads = threads;
  const SessionDiff diff = diff_sessions(earlier, later, targets, options, stop);
  MapDiff result = to_map_diff(diff, request, snapshot.graph.revision);
  result.time_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  return result;
}

}  // namespace cellmap::cli
