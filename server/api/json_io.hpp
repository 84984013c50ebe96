#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/stamp.hpp"
#include "cellmap/document/json.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/store/store.hpp"
#include "server/api/message.hpp"

namespace cellmap::server {

using document::Json;
using document::to_json;
using document::to_rfc3339;

/// Reads a JSON text from outside: at most 16 levels deep, no duplicate keys. Throws
/// Error{kInvalidArgument}. The size was bounded when it was read.
Json parse_json(std::string_view text);

/// Never throws for bytes that are not UTF-8: they become U+FFFD.
std::string dump(const Json& json);
Response json_response(const Json& json, int status = 200);

/// Reads the members of an object and refuses unknown ones, naming what it expected.
/// Every reader throws Error{kInvalidArgument}.
class ObjectReader {
 public:
  ObjectReader(const Json& json, std::string name);

  bool has(const std::string& key) const { return json_.contains(key); }
  std::optional<std::string> text(const std::string& key);
  std::optional<bool> boolean(const std::string& key);
  std::optional<double> number(const std::string& key);
  std::optional<std::uint64_t> integer(const std::string& key, std::uint64_t max);
  std::optional<std::vector<double>> numbers(const std::string& key, std::size_t count);
  std::optional<Pose> pose(const std::string& key);
  std::optional<Matrix6d> matrix(const std::string& key);
  const Json* array(const std::string& key, std::size_t max_size);
  const Json* object(const std::string& key);
  /// Call last: a member that nobody asked for is refused.
  void finish() const;

 private:
  const Json* member(const std::string& key);
  [[noreturn]] void refuse(const std::string& key, const std::string& expected) const;

  const Json& json_;
  std::string name_;
  std::set<std::string> known_;
};

Json to_json(const PoseGraph& graph);
Json ids_to_json(const std::set<CellId>& ids);
Json nodes_to_json(const std::map<CellId, Pose>& poses);

/// Out of the 21 numbers of its upper triangle, by rows.
Matrix6d symmetric_from_upper(std::span<const double> values);

/// Throws Error{kInvalidArgument} or {kUnsupported}.
LatticeSpec lattice_from_json(const Json& json);

/// The members "encoding" (raw, packed, compact) and "bound_m" of an object; nullopt where it has
/// neither. Throws Error{kInvalidArgument}.
std::optional<CellForm> read_form(ObjectReader& reader);

/// Names out of an array of at least one; throws Error{kInvalidArgument}.
std::set<std::string> session_names(const Json& array);

}  // namespace cellmap::server
