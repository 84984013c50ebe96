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
constexpr const char* kWhole = ".cell";
constexpr const char* kCoded = ".ccod";

fs::path state_file(const fs::path& folder) { return folder / "mirror.json"; }

Error missing(const fs::path& file) {
  return Error(ErrorCode::kCorruptData,
               "'" + file.string() + "' is missing; delete the folder and pull again");
}

Json state_from(const Bytes& text, const fs::path& folder) {
  Json json = client::parse_json(client::as_text(text));
  if (client::member(json, "format") != "cellmap-mirror" || client::member(json, "version") != 2) {
    throw Error(ErrorCode::kUnsupported,
                "'" + state_file(folder).string() +
                    "' is not the state of a mirror of version 2; delete the folder and pull "
                    "again");
  }
  return json;
}

Mirror mirror_from(const Json& json, PoseGraph graph) {
  Mirror mirror;
  mirror.server = client::text_member(json, "server");
  mirror.map = client::text_member(json, "map");
  mirror.map_created = client::stamp_from_rfc3339(client::text_member(json, "map_created"));
  mirror.info = client::map_info_from_json(client::member(json, "info"));
  mirror.revision = client::unsigned_member(json, "revision");
  if (json.contains("form")) mirror.form = client::form_from_json(json.at("form"));
  mirror.pose_graph = std::move(graph);
  for (const Json& cell : client::member(json, "cells")) {
    CellRecord record = client::cell_record_from_json(cell);
    const auto node = mirror.pose_graph.nodes.find(record.id);
    if (node == mirror.pose_graph.nodes.end()) {
      throw Error(ErrorCode::kCorruptData, "the mirror's pose graph has no CELL " +
                                               std::to_string(record.id.value) +
                                               "; delete the folder and pull again");
    }
    record.T_map_cell = node->second;  // JSON rounds the last bits
    mirror.cells[record.id] = std::move(record);
  }
  return mirror;
}

}  // namespace

fs::path mirror_cell_file(const fs::path& folder, const ContentHash& hash, const CellForm& form) {
  const char* const extension = form.encoding == KeptEncoding::kRaw ? kWhole : kCoded;
  return folder / "cells" / (to_hex(hash) + extension);
}

std::optional<fs::path> find_mirrored_cell(const fs::path& folder, const ContentHash& hash) {
  for (const CellForm& form : {CellForm{}, CellForm{KeptEncoding::kPacked, 0}}) {
    fs::path file = mirror_cell_file(folder, hash, form);
    if (fs::exists(file)) return file;
  }
  return std::nullopt;
}

std::optional<Mirror> find_mirror(const fs::path& folder) {
  auto text = client::read_file(state_file(folder), kMaxStateBytes);
  while (text) {
    const Json json = state_from(*text, folder);
    const fs::path graph_file = folder / client::text_member(json, "pose_graph");
    if (const auto graph = client::read_file(graph_file, kMaxStateBytes)) {
      return mirror_from(json, decode_pose_graph(*graph));
    }
    // Who follows the map may have replaced both files since the first was read.
    const auto again = client::read_file(state_file(folder), kMaxStateBytes);
    if (!again || *again == *text) throw missing(graph_file);
    text = again;
  }
  return std::nullopt;
}

/// The pose graph first, under a name of its own revision; then the state that names it.
void write_mirror(const Mirror& mirror, const fs::path& folder) {
  const std::string graph_name = "pose-graph-" + std::to_string(mirror.revision) + ".cpgr";
  client::write_file_atomically(folder / graph_name, encode_pose_graph(mirror.pose_graph));
  Json cells = Json::array();
  for (const auto& [id, record] : mirror.cells) cells.push_back(client::to_json(record));
  Json form = Json::object();
  client::put_form(form, mirror.form);
  const Json json = {{"format", "cellmap-mirror"},
                     {"version", 2},
                     {"server", mirror.server},
                     {"map", mirror.map},
                     {"map_created", client::to_rfc3339(mirror.map_created)},
                     {"info", client::to_json(mirror.info)},
                     {"form", form},
                     {"revision", mirror.revision},
                     {"pose_graph", graph_name},
                     {"cells", cells}};
  client::write_file_atomically(state_file(folder), client::dump(json));
}

void apply_changes(const Changes& changes, Mirror& mirror) {
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
  for (Constraint& constraint : graph.constraints) {
    const auto judged = changes.judged.find(constraint.id);
    if (judged == changes.judged.end()) continue;
    constraint.weight = judged->second.weight;
    constraint.pinned = judged->second.pinned;
  }
  graph.unaligned = changes.unaligned;
  graph.revision = mirror.revision = changes.revision;
}

Mirror read_mirror(const fs::path& folder) {
  std::optional<Mirror> mirror = find_mirror(folder);
  if (!mirror) {
    throw Error(ErrorCode::kNotFound, "'" + state_file(folder).string() +
                                          "' is not there; make a mirror with 'cellmap pull'");
  }
  return std::move(*mirror);
}

std::optional<KeptCell> read_mirrored_kept_cell(const fs::path& folder, const ContentHash& hash) {
  const auto file = find_mirrored_cell(folder, hash);
  if (!file) return std::nullopt;
  auto bytes = client::read_file(*file, kMaxCellBytes);
  if (!bytes) return std::nullopt;
  try {
    if (file->extension() == kWhole) return open_kept_cell(*std::move(bytes), hash);
    // "Raw" would unpack it, and a compact CELL stays as it is anyway.
    KeptCell kept = keep_coded_cell(*std::move(bytes), {KeptEncoding::kPacked, 0});
    if (kept.encoded.hash == hash || kept.coded->source == hash) return kept;
  } catch (const Error&) {
    // Said below, with the file's name.
  }
  throw Error(ErrorCode::kCorruptData,
              "'" + file->string() + "' is damaged; delete it and pull again");
}

std::optional<EncodedCell> read_mirrored_cell(const fs::path& folder, const ContentHash& hash) {
  auto kept = read_mirrored_kept_cell(folder, hash);
  if (!kept) return std::nullopt;
  return std::move(kept->encoded);
}

}  // namespace cellmap
