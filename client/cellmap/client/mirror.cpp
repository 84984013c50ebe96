#include "cellmap/client/mirror.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <vector>

#include "cellmap/client/files.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"

namespace cellmap {
namespace fs = std::filesystem;
using client::Json;
namespace {

constexpr std::uint64_t kMaxStateBytes = 1ull << 30;

fs::path state_file(const fs::path& folder) { return folder / "mirror.json"; }

fs::path cell_file(const fs::path& folder, const ContentHash& hash) {
  return folder / "cells" / (to_hex(hash) + ".cell");
}

std::optional<Mirror> read_if_there(const fs::path& folder) {
  const auto text = client::read_file(state_file(folder), kMaxStateBytes);
  if (!text) return std::nullopt;
  const Json json = client::parse_json(client::as_text(*text));
  if (client::member(json, "format") != "cellmap-mirror" || client::member(json, "version") != 1) {
    throw Error(ErrorCode::kUnsupported,
                "'" + state_file(folder).string() + "' is not the state of a mirror of version 1");
  }
  Mirror mirror;
  mirror.server = client::text_member(json, "server");
  mirror.map = client::text_member(json, "map");
  mirror.map_created = client::stamp_from_rfc3339(client::text_member(json, "map_created"));
  mirror.revision = client::unsigned_member(json, "revision");
  for (const Json& cell : client::member(json, "cells")) {
    CellRecord record = client::cell_record_from_json(cell);
    mirror.cells[record.id] = std::move(record);
  }
  const fs::path graph_file = folder / client::text_member(json, "pose_graph");
  const auto graph = client::read_file(graph_file, kMaxStateBytes);
  if (!graph) {
    throw Error(ErrorCode::kCorruptData,
                "'" + graph_file.string() + "' is missing; delete the folder and pull again");
  }
  mirror.pose_graph = decode_pose_graph(*graph);
  return mirror;
}

/// The pose graph first, under a name of its own revision; then the state that names it.
void write(const Mirror& mirror, const fs::path& folder) {
  const std::string graph_name = "pose-graph-" + std::to_string(mirror.revision) + ".cpgr";
  client::write_file_atomically(folder / graph_name, encode_pose_graph(mirror.pose_graph));
  Json cells = Json::array();
  for (const auto& [id, record] : mirror.cells) cells.push_back(client::to_json(record));
  const Json json = {{"format", "cellmap-mirror"},
                     {"version", 1},
                     {"server", mirror.server},
                     {"map", mirror.map},
                     {"map_created", client::to_rfc3339(mirror.map_created)},
                     {"revision", mirror.revision},
                     {"pose_graph", graph_name},
                     {"cells", cells}};
  client::write_file_atomically(state_file(folder), client::dump(json));
}

void apply(const Changes& changes, Mirror& mirror) {
  PoseGraph& graph = mirror.pose_graph;
  for (const CellRecord& record : changes.added) {
    mirror.cells[record.id] = record;
    graph.nodes[record.id] = record.T_map_cell;
  }
  for (const auto& [id, pose] : changes.moved) {
    graph.nodes[id] = pose;
    const auto record = mirror.cells.find(id);
    if (record == mirror.cells.end()) {
      throw Error(ErrorCode::kCorruptData, "the server moved CELL " + std::to_string(id.value) +
                                               ", which the mirror never had; delete the folder "
                                               "and pull again");
    }
    record->second.T_map_cell = pose;
    record->second.moved = changes.revision;
  }
  std::set<ConstraintId> gone(changes.removed_constraints.begin(),
                              changes.removed_constraints.end());
  for (const Constraint& added : changes.added_constraints) gone.insert(added.id);
  std::erase_if(graph.constraints, [&](const Constraint& c) { return gone.contains(c.id); });
  graph.constraints.insert(graph.constraints.end(), changes.added_constraints.begin(),
                           changes.added_constraints.end());
  std::sort(graph.constraints.begin(), graph.constraints.end(),
            [](const Constraint& a, const Constraint& b) { return a.id < b.id; });
  for (const CellId id : changes.removed) {
    mirror.cells.erase(id);
    graph.nodes.erase(id);
  }
  graph.unaligned = changes.unaligned;
  graph.revision = mirror.revision = changes.revision;
}

bool is_here(const fs::path& folder, const CellRecord& record) {
  try {
    const auto bytes = client::read_file(cell_file(folder, record.hash), kMaxCellBytes);
    return bytes && verified_hash(*bytes) == record.hash;
  } catch (const Error&) {
    return false;  // damaged: fetched again
  }
}

/// CELLs of the mirror whose files are missing. Files of CELLs that it had before are trusted by
/// name; new ones are read, because a pull that was broken off may have left them.
std::vector<CellRecord> missing_cells(const Mirror& mirror, Revision before,
                                      const fs::path& folder) {
  std::vector<CellRecord> missing;
  for (const auto& [id, record] : mirror.cells) {
    const bool trusted = record.added <= before && fs::exists(cell_file(folder, record.hash));
    if (!trusted && !is_here(folder, record)) missing.push_back(record);
  }
  return missing;
}

/// Files that the new state does not name.
void remove_leftovers(const Mirror& mirror, const fs::path& folder) {
  std::set<fs::path> wanted;
  for (const auto& [id, record] : mirror.cells) {
    wanted.insert(cell_file(folder, record.hash).filename());
  }
  wanted.insert("pose-graph-" + std::to_string(mirror.revision) + ".cpgr");
  for (const fs::path& place : {folder, folder / "cells"}) {
    std::vector<fs::path> leftovers;
    for (const auto& entry : fs::directory_iterator(place)) {
      const auto extension = entry.path().extension();
      const bool ours = extension == ".cell" || extension == ".cpgr";
      if (ours && !wanted.contains(entry.path().filename())) leftovers.push_back(entry.path());
    }
    for (const fs::path& leftover : leftovers) fs::remove(leftover);
  }
}

/// The folder's state where it fits the server's map, else an empty one.
Mirror state_to_continue(const std::string& server, const MapInfo& map, const fs::path& folder,
                         PullReport& report) {
  const Mirror fresh{server, map.name, map.created, 0, {}, {}};
  std::optional<Mirror> before = read_if_there(folder);
  if (!before) return fresh;
  if (before->map != map.name || before->server != server) {
    throw Error(ErrorCode::kConflict,
                "'" + folder.string() + "' mirrors map '" + before->map + "' of " + before->server +
                    "; give another folder for map '" + map.name + "' of " + server);
  }
  // RFC 3339 text keeps milliseconds.
  constexpr Stamp kMillisecond = 1'000'000;
  const bool same_map = before->map_created / kMillisecond == map.created / kMillisecond;
  report.started_over = !same_map || before->revision > map.revision;
  return report.started_over ? fresh : std::move(*before);
}

}  // namespace

PullReport pull_map(Client& client, const std::string& map, const fs::path& folder,
                    const std::function<void(std::size_t, std::size_t)>& on_cell) {
  PullReport report;
  const MapInfo info = client.map(map);
  Mirror mirror = state_to_continue(to_string(client.url()), info, folder, report);
  client::make_directory(folder / "cells");
  report.from = mirror.revision;
  const Changes changes = client.changes(map, mirror.revision);
  apply(changes, mirror);

  const std::vector<CellRecord> missing = missing_cells(mirror, report.from, folder);
  client.for_each_cell(map, missing, [&](const CellRecord& record, const EncodedCell& cell) {
    client::write_file_atomically(cell_file(folder, record.hash), cell.bytes);
    ++report.fetched;
    report.fetched_bytes += cell.bytes.size();
    if (on_cell) on_cell(report.fetched, missing.size());
  });
  write(mirror, folder);
  remove_leftovers(mirror, folder);
  report.to = mirror.revision;
  report.cells = mirror.cells.size();
  report.moved = changes.moved.size();
  report.removed = changes.removed.size();
  return report;
}

Mirror read_mirror(const fs::path& folder) {
  std::optional<Mirror> mirror = read_if_there(folder);
  if (!mirror) {
    throw Error(ErrorCode::kNotFound, "'" + state_file(folder).string() +
                                          "' is not there; make a mirror with 'cellmap pull'");
  }
  return std::move(*mirror);
}

}  // namespace cellmap
