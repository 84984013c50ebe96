#include "server/api/json_io.hpp"

#include <cmath>
#include <vector>

#include "cellmap/core/error.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

constexpr int kMaxDepth = 16;

[[noreturn]] void invalid(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

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

std::optional<CellForm> read_form(ObjectReader& reader) {
  const auto encoding = reader.text("encoding");
  const auto bound_m = reader.number("bound_m");
  if (!encoding && bound_m) {
    throw Error(ErrorCode::kInvalidArgument, "'bound_m' goes with 'encoding': \"compact\".");
  }
  if (!encoding) return std::nullopt;
  return cell_form(*encoding, bound_m);
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

}  // namespace cellmap::server
