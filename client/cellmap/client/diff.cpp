#include "cellmap/client/diff.hpp"

#include <nlohmann/json.hpp>

#include "cellmap/client/diff_json.hpp"
#include "cellmap/client/transport.hpp"
#include "cellmap/document/change_json.hpp"

namespace cellmap {

using client::Json;

namespace {

std::string numbers(const Eigen::Vector3d& v) {
  if (!v.allFinite()) throw Error(ErrorCode::kInvalidArgument, "a position is not finite");
  const auto text = [](double value) { return client::dump(Json(value), false); };
  return text(v.x()) + "," + text(v.y()) + "," + text(v.z());
}

CellChangeCounts counts_of(const CellDiff& diff, const std::string& session, bool patches) {
  CellChangeCounts counts{diff.cell, session, 0, 0, 0, 0, {}};
  counts.stayed = diff.count(PatchChange::kStayed);
  counts.vanished = diff.count(PatchChange::kVanished);
  counts.appeared = diff.count(PatchChange::kAppeared);
  counts.never_seen = diff.count(PatchChange::kNeverSeen);
  if (patches) counts.changed = diff.changed;
  return counts;
}

}  // namespace

MapDiff diff_sessions(const ClientOptions& options, const std::string& map,
                      const DiffRequest& request) {
  options.validate();
  std::string path = "/v1/maps/" + percent_encoded(map) + "/diff?sessions=" +
                     percent_encoded(request.sessions[0] + "," + request.sessions[1]);
  if (request.near) {
    path += "&near=" + percent_encoded(numbers(*request.near)) +
            "&radius=" + client::dump(Json(request.radius_m), false);
  }
  if (request.patches) path += "&patches=true";
  client::Transport transport(options);
  const client::HttpRequest http{"GET", path, {{"accept", "application/json"}}, ""};
  return client::map_diff_from_json(client::parse_json(transport.perform(http).body));
}

MapDiff to_map_diff(const SessionDiff& diff, const DiffRequest& request, Revision revision) {
  MapDiff result;
  result.revision = revision;
  result.sessions = request.sessions;
  result.pairs = diff.pairs;
  result.regions = diff.regions;
  for (const CellDiff& cell : diff.earlier) {
    result.cells.push_back(counts_of(cell, request.sessions[0], request.patches));
  }
  for (const CellDiff& cell : diff.later) {
    result.cells.push_back(counts_of(cell, request.sessions[1], request.patches));
  }
  return result;
}

namespace client {
namespace {

[[noreturn]] void refuse(const std::string& expected) {
  throw Error(ErrorCode::kCorruptData, "the server's diff: expected " + expected);
}

Eigen::Vector3d vector_member(const Json& json, const char* key) {
  const Json& array = member(json, key);
  if (!array.is_array() || array.size() != 3) refuse(std::string("3 numbers as '") + key + "'");
  Eigen::Vector3d v;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!array[i].is_number()) refuse(std::string("3 numbers as '") + key + "'");
    v[static_cast<Eigen::Index>(i)] = array[i].get<double>();
  }
  return v;
}

double number_member(const Json& json, const char* key) {
  const Json& value = member(json, key);
  if (!value.is_number()) refuse(std::string("a number as '") + key + "'");
  return value.get<double>();
}

std::vector<std::uint32_t> ids_of(const Json& json) {
  if (!json.is_array()) refuse("an array of integers");
  std::vector<std::uint32_t> ids;
  for (const Json& id : json) {
    if (!id.is_number_unsigned() || id.get<std::uint64_t>() > UINT32_MAX) {
      refuse("integers of 32 bits");
    }
    ids.push_back(id.get<std::uint32_t>());
  }
  return ids;
}

const Json& array_member(const Json& json, const char* key) {
  const Json& array = member(json, key);
  if (!array.is_array()) refuse(std::string("an array as '") + key + "'");
  return array;
}

ChangeRegion region_from_json(const Json& json) {
  ChangeRegion region;
  const std::string change = text_member(json, "change");
  if (change != "vanished" && change != "appeared") refuse("vanished or appeared as 'change'");
  region.change = change == "vanished" ? PatchChange::kVanished : PatchChange::kAppeared;
  region.centroid = vector_member(json, "centroid");
  region.box = Eigen::AlignedBox3d(vector_member(json, "min"), vector_member(json, "max"));
  region.patches = static_cast<std::uint32_t>(unsigned_member(json, "patches"));
  region.area_m2 = number_member(json, "area_m2");
  for (const std::uint32_t id : ids_of(member(json, "cells"))) region.cells.push_back(CellId{id});
  return region;
}

CellChangeCounts counts_from_json(const Json& json) {
  CellChangeCounts counts;
  counts.cell = CellId{static_cast<std::uint32_t>(unsigned_member(json, "id"))};
  counts.session = text_member(json, "session");
  counts.stayed = unsigned_member(json, "stayed");
  counts.vanished = unsigned_member(json, "vanished");
  counts.appeared = unsigned_member(json, "appeared");
  counts.never_seen = unsigned_member(json, "never_seen");
  if (json.contains("changed")) counts.changed = ids_of(json.at("changed"));
  return counts;
}

}  // namespace

Json to_json(const MapDiff& diff, bool patches) {
  Json regions = Json::array(), cells = Json::array();
  for (const ChangeRegion& region : diff.regions) regions.push_back(document::to_json(region));
  for (const CellChangeCounts& counts : diff.cells) {
    cells.push_back({{"id", counts.cell.value},
                     {"session", counts.session},
                     {"stayed", counts.stayed},
                     {"vanished", counts.vanished},
                     {"appeared", counts.appeared},
                     {"never_seen", counts.never_seen}});
    if (patches) cells.back()["changed"] = counts.changed;
  }
  return {{"revision", diff.revision},     {"sessions", diff.sessions}, {"pairs", diff.pairs},
          {"regions", std::move(regions)}, {"cells", std::move(cells)}, {"time_ms", diff.time_ms}};
}

MapDiff map_diff_from_json(const Json& json) {
  MapDiff diff;
  diff.revision = unsigned_member(json, "revision");
  const Json& sessions = array_member(json, "sessions");
  if (sessions.size() != 2 || !sessions[0].is_string() || !sessions[1].is_string()) {
    refuse("two names as 'sessions'");
  }
  diff.sessions = {sessions[0].get<std::string>(), sessions[1].get<std::string>()};
  diff.pairs = unsigned_member(json, "pairs");
  for (const Json& region : array_member(json, "regions")) {
    diff.regions.push_back(region_from_json(region));
  }
  for (const Json& cell : array_member(json, "cells")) diff.cells.push_back(counts_from_json(cell));
  diff.time_ms = number_member(json, "time_ms");
  return diff;
}

}  // namespace client
}  // namespace cellmap
