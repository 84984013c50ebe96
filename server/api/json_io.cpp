#include "server/api/json_io.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

constexpr int kMaxDepth = 16;

[[noreturn]] void invalid(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

Json vector_to_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::vector<double> finite_numbers(const Json& json, std::size_t count) {
  std::vector<double> values;
  if (!json.is_array() || json.size() != count) return values;
  for (const auto& element : json) {
    if (!element.is_number() || !std::isfinite(element.get<double>())) return {};
    values.push_back(element.get<double>());
  }
  return values;
}

}  // namespace

Json parse_json(std::string_view text) {
  std::vector<std::set<std::string>> keys;
  const auto check = [&](int depth, Json::parse_event_t event, Json& parsed) {
    using Event = Json::parse_event_t;
    if ((event == Event::object_start || event == Event::array_start) && depth >= kMaxDepth) {
      invalid("The JSON body is nested deeper than " + std::to_string(kMaxDepth) + " levels.");
    }
    if (event == Event::object_start) keys.emplace_back();
    if (event == Event::object_end) keys.pop_back();
    if (event == Event::key && !keys.back().insert(parsed.get<std::string>()).second) {
      invalid("The JSON body has the key " + in_quotes(parsed.get<std::string>()) + " twice.");
    }
    return true;
  };
  try {
    return Json::parse(text, check);
  } catch (const Json::parse_error& error) {
    invalid("The body is not JSON: error at byte " + std::to_string(error.byte) + ".");
  } catch (const Json::exception&) {
    invalid("The body is not JSON: a number is out of range.");
  }
}

std::string dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Response json_response(const Json& json, int status) {
  Response response;
  response.status = status;
  response.headers.set("Content-Type", "application/json");
  response.body = dump(json);
  return response;
}

ObjectReader::ObjectReader(const Json& json, std::string name)
    : json_(json), name_(std::move(name)) {
  if (!json.is_object()) invalid("Expected " + name_ + " to be a JSON object.");
}

const Json* ObjectReader::member(const std::string& key) {
  known_.insert(key);
  const auto found = json_.find(key);
  return found == json_.end() ? nullptr : &*found;
}

void ObjectReader::refuse(const std::string& key, const std::string& expected) const {
  invalid("Expected '" + key + "' in " + name_ + " to be " + expected + ", found " +
          in_quotes(dump(json_.at(key))) + ".");
}

std::optional<std::string> ObjectReader::text(const std::string& key) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  if (!json->is_string()) refuse(key, "a string");
  return json->get<std::string>();
}

std::optional<bool> ObjectReader::boolean(const std::string& key) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  if (!json->is_boolean()) refuse(key, "true or false");
  return json->get<bool>();
}

std::optional<double> ObjectReader::number(const std::string& key) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  if (!json->is_number() || !std::isfinite(json->get<double>())) refuse(key, "a number");
  return json->get<double>();
}

std::optional<std::uint64_t> ObjectReader::integer(const std::string& key, std::uint64_t max) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  if (!json->is_number_unsigned() || json->get<std::uint64_t>() > max) {
    refuse(key, "an integer from 0 to " + std::to_string(max));
  }
  return json->get<std::uint64_t>();
}

std::optional<std::vector<double>> ObjectReader::numbers(const std::string& key,
                                                         std::size_t count) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  auto values = finite_numbers(*json, count);
  if (values.empty()) refuse(key, "an array of " + std::to_string(count) + " finite numbers");
  return values;
}

std::optional<Pose> ObjectReader::pose(const std::string& key) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  const auto values = finite_numbers(*json, 7);
  if (values.empty()) refuse(key, "seven finite numbers [x, y, z, qx, qy, qz, qw]");
  return pose_from_xyz_qxyzw(std::span<const double, 7>(values.data(), 7));
}

std::optional<Matrix6d> ObjectReader::matrix(const std::string& key) {
  const Json* json = member(key);
  if (!json) return std::nullopt;
  const auto values = finite_numbers(*json, 21);
  if (values.empty()) refuse(key, "21 finite numbers, the upper triangle by rows");
  return symmetric_from_upper(values);
}

const Json* ObjectReader::array(const std::string& key, std::size_t max_size) {
  const Json* json = member(key);
  if (!json) return nullptr;
  if (!json->is_array() || json->size() > max_size) {
    refuse(key, "an array of at most " + std::to_string(max_size) + " elements");
  }
  return json;
}

const Json* ObjectReader::object(const std::string& key) {
  const Json* json = member(key);
  if (json && !json->is_object()) refuse(key, "an object");
  return json;
}

void ObjectReader::finish() const {
  for (const auto& [key, value] : json_.items()) {
    if (known_.contains(key)) continue;
    std::string expected;
    for (const auto& name : known_) expected += (expected.empty() ? "" : ", ") + name;
    invalid("Unknown member " + in_quotes(key) + " in " + name_ + "; it can have: " + expected +
            ".");
  }
}

Matrix6d symmetric_from_upper(std::span<const double> values) {
  Matrix6d matrix;
  std::size_t next = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) {
      matrix(row, column) = matrix(column, row) = values[next++];
    }
  }
  return matrix;
}

std::set<std::string> session_names(const Json& array) {
  std::set<std::string> names;
  for (const Json& name : array) {
    if (!name.is_string()) invalid("Expected 'sessions' to hold text only.");
    names.insert(name.get<std::string>());
  }
  if (names.empty()) invalid("Expected 'sessions' to name at least one session.");
  return names;
}

Json to_json(const Pose& pose) { return to_xyz_qxyzw(pose); }

Json to_json(const Matrix6d& symmetric) {
  Json json = Json::array();
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) json.push_back(symmetric(row, column));
  }
  return json;
}

Json to_json(const RegistrationScores& scores) {
  return {{"points", scores.points},
          {"hits", scores.hits},
          {"inlier_ratio_all", scores.inlier_ratio_all},
          {"inlier_ratio_hit", scores.inlier_ratio_hit},
          {"share_in_front", scores.share_in_front},
          {"share_beyond", scores.share_beyond},
          {"median_residual_m", scores.median_residual_m}};
}

Json to_json(const Constraint& constraint) {
  return {{"id", constraint.id.value},
          {"from", constraint.from.value},
          {"to", constraint.to.value},
          {"pose", to_json(constraint.T_from_to)},
          {"information", to_json(constraint.information)},
          {"kind", to_string(constraint.kind)},
          {"origin", to_string(constraint.origin)},
          {"scores", to_json(constraint.scores)},
          {"weight", constraint.weight},
          {"pinned", constraint.pinned},
          {"verdict", to_string(verdict(constraint))}};
}

Json to_json(const LatticeSpec& lattice) {
  return {{"kind", to_string(lattice.kind)}, {"size", lattice.size}};
}

Json to_json(const MapInfo& map) {
  Json bounds;
  if (!map.bounds.isEmpty()) {
    bounds = {{"min", vector_to_json(map.bounds.min())}, {"max", vector_to_json(map.bounds.max())}};
  }
  constexpr std::uint64_t kRawPointBytes = 16, kVoxelPointBytes = 12;
  return {{"name", map.name},
          {"lattice", to_json(map.lattice)},
          {"revision", map.revision},
          {"created", rfc3339(map.created)},
          {"cells", map.cells},
          {"planes", map.planes},
          {"constraints", map.constraints},
          {"encoded_bytes", map.encoded_bytes},
          {"stored_bytes", map.stored_bytes},
          {"scans", map.scans},
          {"raw_points", map.raw_points},
          {"raw_bytes", map.raw_points * kRawPointBytes},
          {"voxel_points", map.voxel_points},
          {"voxel_bytes", map.voxel_points * kVoxelPointBytes},
          {"bounds", bounds},
          {"georeference", map.georeference ? to_json(*map.georeference) : Json()},
          {"sessions", map.sessions}};
}

Json to_json(const Georeference& georeference) {
  const Eigen::Quaterniond q(georeference.R_enu_map);
  return {{"latitude_deg", georeference.latitude_deg},
          {"longitude_deg", georeference.longitude_deg},
          {"height_m", georeference.height_m},
          {"q_enu_map", {q.x(), q.y(), q.z(), q.w()}}};
}

Json to_json(const GeoPose& geopose) {
  const Eigen::Quaterniond& q = geopose.q_enu_body;
  return {
      {"position",
       {{"lat", geopose.latitude_deg}, {"lon", geopose.longitude_deg}, {"h", geopose.height_m}}},
      {"quaternion", {{"x", q.x()}, {"y", q.y()}, {"z", q.z()}, {"w", q.w()}}}};
}

Json to_json(const CellRecord& cell) {
  const std::string hash = to_hex(cell.hash);
  return {
      {"id", cell.id.value},        {"etag", '"' + hash + '"'},  {"hash", hash},
      {"added", cell.added},        {"moved", cell.moved},       {"pose", to_json(cell.T_map_cell)},
      {"session", cell.session},    {"sequence", cell.sequence}, {"planes", cell.planes},
      {"bytes", cell.encoded_bytes}};
}

Json nodes_to_json(const std::map<CellId, Pose>& poses) {
  Json json = Json::array();
  for (const auto& [id, pose] : poses) {
    json.push_back({{"id", id.value}, {"pose", to_json(pose)}});
  }
  return json;
}

Json ids_to_json(const std::set<CellId>& ids) {
  Json list = Json::array();
  for (const CellId id : ids) list.push_back(id.value);
  return list;
}

Json to_json(const PoseGraph& graph) {
  Json constraints = Json::array();
  for (const auto& constraint : graph.constraints) constraints.push_back(to_json(constraint));
  return {{"revision", graph.revision},
          {"nodes", nodes_to_json(graph.nodes)},
          {"unaligned", ids_to_json(graph.unaligned)},
          {"constraints", std::move(constraints)}};
}

LatticeSpec lattice_from_json(const Json& json) {
  ObjectReader reader(json, "lattice");
  LatticeSpec spec;
  if (const auto kind = reader.text("kind")) spec.kind = lattice_kind_from(*kind);
  if (const auto size = reader.integer("size", UINT32_MAX)) {
    spec.size = static_cast<std::uint32_t>(*size);
  }
  reader.finish();
  spec.validate();
  return spec;
}

std::string rfc3339(Stamp unix_time) {
  constexpr Stamp kSecond = 1'000'000'000;
  const std::time_t seconds = unix_time / kSecond;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ",
                parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday, parts.tm_hour, parts.tm_min,
                parts.tm_sec, static_cast<int>(unix_time % kSecond / 1'000'000));
  return text.data();
}

}  // namespace cellmap::server
