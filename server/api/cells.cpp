#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/api/api.hpp"
#include "server/api/coded_cells.hpp"
#include "server/api/conditions.hpp"
#include "server/api/media_types.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// /v1/maps/{map}/cells and /v1/maps/{map}/cells/{cell}.

namespace cellmap::server {
namespace {

CellQuery read_query(const Call& call) {
  CellQuery query;
  if (const auto near = call.query_numbers("near", 3)) {
    query.near = Eigen::Vector3d((*near)[0], (*near)[1], (*near)[2]);
  }
  const auto radius = call.query_number("radius", 0, 1e7);
  if (query.near.has_value() != radius.has_value() || (radius && *radius <= 0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "'near' and 'radius' (above 0) go together: near=x,y,z&radius=30.");
  }
  query.radius_m = radius.value_or(0);
  if (const auto box = call.query_numbers("bbox", 6)) {
    const Eigen::Vector3d min((*box)[0], (*box)[1], (*box)[2]);
    const Eigen::Vector3d max((*box)[3], (*box)[4], (*box)[5]);
    if ((min.array() > max.array()).any()) {
      throw Error(ErrorCode::kInvalidArgument,
                  "'bbox' is x0,y0,z0,x1,y1,z1 with every minimum at most its maximum.");
    }
    query.box = Eigen::AlignedBox3d(min, max);
  }
  query.session = call.query("session");
  query.since = call.query_integer("since", 0, INT64_MAX).value_or(0);
  query.limit = call.query_integer("limit", 1, 10'000).value_or(query.limit);
  query.cursor = call.query("cursor").value_or("");
  return query;
}

Response list_cells(Services& services, const Call& call) {
  const CellPage page = services.store.cells(call.path("map"), read_query(call));
  Json cells = Json::array();
  for (const auto& cell : page.cells) cells.push_back(to_json(cell));
  Json cursor;
  if (!page.next_cursor.empty()) cursor = page.next_cursor;
  return json_response(
      {{"revision", page.revision}, {"cells", std::move(cells)}, {"next_cursor", cursor}});
}

Json cell_document(const CellRecord& record, const Cell& cell) {
  Json planes = Json::array();
  for (const auto& p : cell.planes) planes.push_back({p.distance_m, p.nx, p.ny, p.nz});
  const auto& s = cell.statistics;
  return {{"id", record.id.value},
          {"hash", to_hex(record.hash)},
          {"lattice", to_json(cell.lattice)},
          {"session", cell.session},
          {"sequence", cell.sequence},
          {"T_odom_cell", to_json(cell.T_odom_cell)},
          {"T_map_cell", to_json(record.T_map_cell)},
          {"first_stamp", cell.first_stamp},
          {"last_stamp", cell.last_stamp},
          {"first_scan", cell.first_scan},
          {"scan_count", cell.scan_count},
          {"statistics",
           {{"points", s.points},
            {"points_in_planes", s.points_in_planes},
            {"patches_hit", s.patches_hit},
            {"rejected_few_points", s.rejected_few_points},
            {"rejected_gap", s.rejected_gap},
            {"rejected_planarity", s.rejected_planarity},
            {"rejected_grazing", s.rejected_grazing}}},
          {"indices", cell.indices},
          {"planes", std::move(planes)}};
}

std::string pose_header(const Pose& pose) {
  std::string text;
  for (const double value : to_xyz_qxyzw(pose)) {
    std::array<char, 32> number;  // the shortest text that reads back as the same number
    const auto end = std::to_chars(number.data(), number.data() + number.size(), value).ptr;
    if (!text.empty()) text += ' ';
    text.append(number.data(), end);
  }
  return text;
}

std::string number_text(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6g", value);
  return text.data();
}

/// The three forms of a CELL, each with its own entity tag.
struct CellTags {
  std::string hash;  ///< in hexadecimal digits
  std::string identity() const { return '"' + hash + '"'; }
  std::string zstd() const { return '"' + hash + "-zstd\""; }
  std::string json() const { return '"' + hash + "-json\""; }
};

/// The whole or the asked range of bytes with the entity tag `tag`.
Response ranged(const Call& call, Response response, std::shared_ptr<const Bytes> bytes,
                std::size_t size, const std::string& tag) {
  auto range = call.header("Range");
  const auto condition = call.header("If-Range");
  if (condition && *condition != tag) range.reset();
  response.headers.set("ETag", tag);
  response.headers.set("Accept-Ranges", "bytes");
  const auto part = answer_range(range, size, response);
  if (!part) return range_not_satisfiable(size);
  response.body = SharedBytes{std::move(bytes), part->offset, part->length};
  return response;
}

/// How far planes may be from those that were measured, where the map keeps the CELL compact:
/// neither raw bytes nor JSON have a place for it.
void say_bound(Response& response, const CellForm& form) {
  if (!form.is_exact()) response.headers.set("CELLmap-Bound", number_text(form.bound_m()));
}

/// The FlatBuffers form: the stored zstd frame as it is where the client takes it and the CELL is
/// kept so, else the whole or a range of the bytes.
Response binary_cell(const Call& call, const StoredCell& stored, const CellTags& tags,
                     Response response) {
  response.headers.set("Content-Type", kCellType);
  const auto condition = call.header("If-Range");
  const bool is_range = call.header("Range") && (!condition || *condition == tags.identity());
  if (!is_range && stored.form.encoding == KeptEncoding::kRaw &&
      accepts_coding(call.header("Accept-Encoding"), "zstd")) {
    response.headers.set("ETag", tags.zstd());
    response.headers.set("Content-Encoding", "zstd");
    response.body = SharedBytes{stored.frame, 0, stored.frame->size()};
    return response;
  }
  auto bytes = std::make_shared<const Bytes>(encoded_of(stored).bytes);
  const std::size_t size = bytes->size();
  return ranged(call, std::move(response), std::move(bytes), size, tags.identity());
}

/// A coded form, or its coarse layer, which is its first bytes.
Response coded_cell(CodedCells& coded_cells, const Call& call, const CellRecord& record,
                    Response response) {
  const auto [bytes, form] = coded_cells.get(
      call.path("map"), record.id, coded_form(call.header("Accept").value_or(""), kCodedCellType));
  const std::size_t coarse = coarse_cell_bytes(*bytes);
  const std::string tag =
      '"' + to_hex(coded_content_hash(*bytes)) + (form.is_coarse ? "-coarse\"" : "\"");
  response.headers.set("Content-Type", kCodedCellType + to_parameters(form));
  response.headers.set("CELLmap-File-Bytes", std::to_string(bytes->size()));
  response.headers.set("CELLmap-Coarse-Bytes", std::to_string(coarse));
  const auto condition = call.header("If-None-Match");
  if (condition && matches_etag(*condition, std::array{tag})) {
    response.headers.set("ETag", tag);
    response.status = 304;
    return response;
  }
  return ranged(call, std::move(response), bytes, form.is_coarse ? coarse : bytes->size(), tag);
}

Response get_cell(Services& services, CodedCells& coded_cells, const Call& call) {
  constexpr std::array<std::string_view, 3> types{kCellType, "application/json", kCodedCellType};
  const auto type = negotiate(call.header("Accept"), types);
  if (!type) return not_acceptable(types);
  const auto& map = call.path("map");
  const CellId id{call.path_id("cell")};
  const auto asked = call.query("hash");
  const auto remembered = asked ? services.store.remembered_cell(map, id, *asked) : std::nullopt;
  const auto [revision, record, known] =
      remembered ? *remembered : services.store.current_cell(map, id);
  const CellTags tags{to_hex(record.hash)};

  // A CELL gets other content where its map is converted: for ever is only what a hash names.
  if (asked && *asked != tags.hash) {
    throw Error(ErrorCode::kNotFound,
                "The CELL has not the content 'hash' names (any more), but " + tags.hash + ".");
  }
  Response response;
  response.headers.set("Cache-Control",
                       asked ? "public, max-age=31536000, immutable" : "public, no-cache");
  response.headers.set("Vary", "Accept, Accept-Encoding");
  response.headers.set("CELLmap-Pose", pose_header(record.T_map_cell));
  response.headers.set("CELLmap-Revision", std::to_string(revision));
  if (*type == kCodedCellType) return coded_cell(coded_cells, call, record, std::move(response));
  const bool as_json = *type == "application/json";
  const auto condition = call.header("If-None-Match");
  if (condition &&
      matches_etag(*condition, std::array{tags.identity(), tags.zstd(), tags.json()})) {
    const bool zstd = accepts_coding(call.header("Accept-Encoding"), "zstd");
    response.headers.set("ETag", as_json ? tags.json() : zstd ? tags.zstd() : tags.identity());
    response.status = 304;
    return response;
  }
  const StoredCell stored = known ? *known : services.store.stored_cell(map, record.id);
  // Converted between the two reads: what was said above is of another content.
  if (stored.hash != record.hash) return get_cell(services, coded_cells, call);
  say_bound(response, stored.form);
  if (!as_json) return binary_cell(call, stored, tags, std::move(response));
  response.headers.set("Content-Type", "application/json");
  response.headers.set("ETag", tags.json());
  response.body = dump(cell_document(record, *open_stored_cell(stored).cell));
  return response;
}

std::optional<CellRecord> find_cell(const Store& store, const std::string& map, CellId id) {
  try {
    return store.cell(map, id);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kNotFound) throw;
    return std::nullopt;
  }
}

/// True where the CELL was made of the one by this hash.
bool is_source(const Store& store, const std::string& map, const CellRecord& cell,
               const ContentHash& hash) {
  const auto keeping = store.keeping(map, cell.session);
  const auto found = std::ranges::find(keeping, cell.id, &CellKeeping::id);
  return found != keeping.end() && found->source == hash;
}

/// Answers a PUT of a CELL that is there, or nullopt where there is none. `sent` is its hash
/// before it was brought into the map's form.
std::optional<Response> answer_existing(Services& services, const Call& call, CellId id,
                                        const ContentHash& hash, const ContentHash& sent) {
  const auto existing = find_cell(services.store, call.path("map"), id);
  if (!existing) return std::nullopt;
  if (call.header("If-None-Match") == "*") {
    throw Error(ErrorCode::kPreconditionFailed, "There is a CELL by this id already.");
  }
  if (existing->hash != hash && existing->hash != sent &&
      !is_source(services.store, call.path("map"), *existing, sent)) {
    throw Error(ErrorCode::kConflict,
                "A CELL never changes, and the one by this id has other content (" +
                    to_hex(existing->hash) + ").");
  }
  Json json = to_json(*existing);
  json["revision"] = services.store.map(call.path("map")).revision;
  return json_response(json);
}

/// What becomes of a body in a map of this form.
KeptCell kept_cell(const std::string& type, const std::string& body, const CellForm& form) {
  Bytes bytes(as_bytes(body).begin(), as_bytes(body).end());
  if (type == kCodedCellType) return keep_coded_cell(std::move(bytes), form);
  const ContentHash hash = verified_hash(bytes);
  auto cell = std::make_shared<const Cell>(decode_cell(bytes));
  return keep_cell(std::move(cell), form, EncodedCell{hash, std::move(bytes)});
}

Response put_cell(Services& services, const Call& call) {
  const auto& map = call.path("map");
  const auto state = services.maps.open(map);
  const CellId id{call.path_id("cell")};
  const std::string type = call.content_type({kCellType, kCodedCellType});
  const std::string body = call.content(kMaxCellBytes);
  KeptCell kept = kept_cell(type, body, services.store.map(map).form);
  const bool is_raw = type == kCellType && kept.coded;
  const ContentHash sent = is_raw ? kept.coded->source : kept.encoded.hash;
  Pose T_map_cell = kept.cell->T_odom_cell;
  if (const auto header = call.header("CELLmap-Pose")) {
    const auto numbers = parse_numbers(*header, ' ', 7, "CELLmap-Pose");
    T_map_cell = pose_from_xyz_qxyzw(std::span<const double, 7>(numbers.data(), 7));
  }
  NewCell added{.id = id,
                .cell = std::move(kept.cell),
                .encoded = std::move(kept.encoded),
                .coded = std::move(kept.coded),
                .T_map_cell = T_map_cell,
                .scans = {},
                .raw_points = 0};

  const std::lock_guard lock(state->writer());
  if (auto answer = answer_existing(services, call, id, added.encoded.hash, sent)) {
    return *std::move(answer);
  }
  MapUpdate update;
  update.cells.push_back(std::move(added));
  const auto committed = services.store.commit(map, update);
  services.metrics.cells_committed(1);
  Json json = to_json(services.store.cell(map, id));
  json["revision"] = committed.revision;
  Response response = json_response(json, 201);
  response.headers.set("Location", "/v1/maps/" + map + "/cells/" + std::to_string(id.value));
  return response;
}

}  // namespace

void add_cell_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  router.add({"GET",
              "/v1/maps/{map}/cells",
              {"near", "radius", "bbox", "since", "session", "limit", "cursor"},
              0,
              json,
              [&](const Call& call) { return list_cells(services, call); }});
  const std::string one = "/v1/maps/{map}/cells/{cell}";
  const auto coded_cells = std::make_shared<CodedCells>(services.store);
  router.add({"GET", one, {"hash"}, 0, {}, [&services, coded_cells](const Call& call) {
                return get_cell(services, *coded_cells, call);
              }});
  router.add({"PUT", one, {}, kMaxCellBytes, json, [&](const Call& call) {
                return put_cell(services, call);
              }});
}

}  // namespace cellmap::server
