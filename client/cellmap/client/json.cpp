#include "cellmap/client/json.hpp"

#include <array>
#include <chrono>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

namespace cellmap::client {
namespace {

constexpr int kMaxDepth = 32;

/// Runs a decoder and turns the JSON library's complaints (missing key, wrong type) into ours.
template <typename Decode>
decltype(auto) decoded(const char* what, Decode decode) {
  try {
    return decode();
  } catch (const Json::exception& error) {
    throw Error(ErrorCode::kCorruptData, std::string("the server's ") + what +
                                             " is not as the API describes it (" + error.what() +
                                             "); do client and server have the same version?");
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kCorruptData) throw;
    throw Error(ErrorCode::kCorruptData, std::string("the server's ") + what +
                                             " holds a value out of range: " + error.what());
  }
}

template <typename Integer>
Integer integer(const Json& json) {
  if (!json.is_number_unsigned() ||
      json.get<std::uint64_t>() > static_cast<std::uint64_t>(std::numeric_limits<Integer>::max())) {
    throw Error(ErrorCode::kCorruptData, "a non-negative integer of " +
                                             std::to_string(8 * sizeof(Integer)) +
                                             " bits was expected, found " + dump(json, false));
  }
  return static_cast<Integer>(json.get<std::uint64_t>());
}

std::uint64_t count(const Json& json, const char* key) {
  return integer<std::uint64_t>(json.at(key));
}

template <typename Id>
Id id(const Json& json) {
  return Id{integer<std::uint32_t>(json)};
}

/// A number that may be left out or null.
double number_or(const Json& json, const char* key, double otherwise) {
  const auto found = json.find(key);
  return found == json.end() || found->is_null() ? otherwise : found->get<double>();
}

template <std::size_t N>
std::array<double, N> numbers(const Json& json) {
  if (!json.is_array() || json.size() != N) {
    throw Error(ErrorCode::kCorruptData, "an array of " + std::to_string(N) +
                                             " numbers was expected, found " + dump(json, false));
  }
  std::array<double, N> values;
  for (std::size_t i = 0; i < N; ++i) values[i] = json[i].get<double>();
  return values;
}

Json vector3(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Eigen::Vector3d vector3_from(const Json& json) {
  const auto v = numbers<3>(json);
  return {v[0], v[1], v[2]};
}

LatticeSpec lattice_from(const Json& json) {
  return {lattice_kind_from(json.at("kind").get<std::string>()),
          integer<std::uint32_t>(json.at("size"))};
}

Georeference georeference_from(const Json& json) {
  const auto q = numbers<4>(json.at("q_enu_map"));
  const std::array<double, 7> pose = {0, 0, 0, q[0], q[1], q[2], q[3]};
  return {json.at("latitude_deg").get<double>(), json.at("longitude_deg").get<double>(),
          json.at("height_m").get<double>(), pose_from_xyz_qxyzw(pose).linear()};
}

GeoPose geopose_from(const Json& json) {
  const Json &position = json.at("position"), &q = json.at("quaternion");
  return {position.at("lat").get<double>(), position.at("lon").get<double>(),
          position.at("h").get<double>(),
          Eigen::Quaterniond(q.at("w").get<double>(), q.at("x").get<double>(),
                             q.at("y").get<double>(), q.at("z").get<double>())};
}

ConstraintKind kind_from(const std::string& name) {
  for (const auto kind :
       {ConstraintKind::kOdometry, ConstraintKind::kBidirectional, ConstraintKind::kLoop}) {
    if (to_string(kind) == name) return kind;
  }
  throw Error(ErrorCode::kCorruptData, "unknown constraint kind '" + name + "'");
}

ConstraintOrigin origin_from(const std::string& name) {
  for (const auto origin :
       {ConstraintOrigin::kMapper, ConstraintOrigin::kDetection, ConstraintOrigin::kUser}) {
    if (to_string(origin) == name) return origin;
  }
  throw Error(ErrorCode::kCorruptData, "unknown constraint origin '" + name + "'");
}

template <typename T, typename Decode>
std::vector<T> list_of(const Json& json, Decode decode) {
  std::vector<T> list;
  for (const Json& item : json) list.push_back(decode(item));
  return list;
}

}  // namespace

Json parse_json(std::string_view text) {
  const auto bounded = [](int depth, Json::parse_event_t, Json&) {
    if (depth > kMaxDepth) {
      throw Error(ErrorCode::kCorruptData, "JSON nested deeper than 32 levels");
    }
    return true;
  };
  return decoded("answer", [&] { return Json::parse(text, bounded); });
}

const Json& member(const Json& json, const char* key) {
  return decoded("answer", [&]() -> const Json& { return json.at(key); });
}

std::string text_member(const Json& json, const char* key) {
  return decoded("answer", [&] { return json.at(key).get<std::string>(); });
}

std::uint64_t unsigned_member(const Json& json, const char* key) {
  return decoded("answer", [&] { return count(json, key); });
}

std::string dump(const Json& json, bool indented) {
  return json.dump(indented ? 2 : -1, ' ', false, Json::error_handler_t::replace);
}

Json to_json(const Pose& pose) { return to_xyz_qxyzw(pose); }

Pose pose_from_json(const Json& json) {
  return decoded("pose", [&] { return pose_from_xyz_qxyzw(numbers<7>(json)); });
}

Json to_json(const Matrix6d& matrix) {
  Json values = Json::array();
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) values.push_back(matrix(row, column));
  }
  return values;
}

Matrix6d matrix_from_json(const Json& json) {
  return decoded("6x6 matrix", [&] {
    const auto values = numbers<21>(json);
    Matrix6d matrix;
    std::size_t next = 0;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        matrix(row, column) = matrix(column, row) = values[next++];
      }
    }
    return matrix;
  });
}

std::string to_rfc3339(Stamp unix_time) {
  using namespace std::chrono;
  const sys_time<nanoseconds> time{nanoseconds(unix_time)};
  const auto day = floor<days>(time);
  const year_month_day date(day);
  const hh_mm_ss clock(floor<milliseconds>(time - day));
  char text[40];
  std::snprintf(text, sizeof text, "%04d-%02u-%02uT%02d:%02d:%02d.%03dZ", int(date.year()),
                unsigned(date.month()), unsigned(date.day()), int(clock.hours().count()),
                int(clock.minutes().count()), int(clock.seconds().count()),
                int(clock.subseconds().count()));
  return text;
}

Stamp stamp_from_rfc3339(const std::string& text) {
  using namespace std::chrono;
  int year, month, day, hour, minute, used = 0;
  double second;
  char zone = 0;
  const int fields = std::sscanf(text.c_str(), "%4d-%2d-%2d%*1[Tt ]%2d:%2d:%lf%c%n", &year, &month,
                                 &day, &hour, &minute, &second, &zone, &used);
  const year_month_day date{std::chrono::year(year), std::chrono::month(unsigned(month)),
                            std::chrono::day(unsigned(day))};
  if (fields < 7 || (zone != 'Z' && zone != 'z') || used != int(text.size()) || !date.ok() ||
      hour < 0 || hour > 23 || minute < 0 || minute > 59 || !(second >= 0 && second < 61)) {
    throw Error(ErrorCode::kCorruptData,
                "'" + text + "' is not a time such as 2026-11-22T03:45:09Z");
  }
  const nanoseconds midnight = sys_days(date).time_since_epoch();
  return (midnight + hours(hour) + minutes(minute)).count() + stamp_from_seconds(second);
}

Json to_json(const MapInfo& map) {
  constexpr std::uint64_t kRawPointBytes = 16, kVoxelPointBytes = 12;
  Json bounds = nullptr;
  if (!map.bounds.isEmpty()) {
    bounds = {{"min", vector3(map.bounds.min())}, {"max", vector3(map.bounds.max())}};
  }
  return {{"name", map.name},
          {"lattice", {{"kind", to_string(map.lattice.kind)}, {"size", map.lattice.size}}},
          {"revision", map.revision},
          {"created", to_rfc3339(map.created)},
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

MapInfo map_info_from_json(const Json& json) {
  return decoded("map summary", [&] {
    MapInfo map;
    map.name = json.at("name");
    map.lattice = lattice_from(json.at("lattice"));
    map.revision = count(json, "revision");
    map.created = stamp_from_rfc3339(json.at("created"));
    map.cells = count(json, "cells");
    map.planes = count(json, "planes");
    map.constraints = count(json, "constraints");
    map.encoded_bytes = count(json, "encoded_bytes");
    map.stored_bytes = count(json, "stored_bytes");
    map.scans = count(json, "scans");
    map.raw_points = count(json, "raw_points");
    map.voxel_points = count(json, "voxel_points");
    if (const Json& bounds = json.at("bounds"); !bounds.is_null()) {
      map.bounds.extend(vector3_from(bounds.at("min")));
      map.bounds.extend(vector3_from(bounds.at("max")));
    }
    map.sessions = json.at("sessions").get<std::vector<std::string>>();
    if (const Json where = json.value("georeference", Json()); !where.is_null()) {
      map.georeference = georeference_from(where);
    }
    return map;
  });
}

Json to_json(const CellRecord& cell) {
  return {{"id", cell.id.value},       {"etag", '"' + to_hex(cell.hash) + '"'},
          {"hash", to_hex(cell.hash)}, {"added", cell.added},
          {"moved", cell.moved},       {"pose", to_json(cell.T_map_cell)},
          {"session", cell.session},   {"sequence", cell.sequence},
          {"planes", cell.planes},     {"bytes", cell.encoded_bytes}};
}

CellRecord cell_record_from_json(const Json& json) {
  return decoded("CELL summary", [&] {
    CellRecord cell;
    cell.id = id<CellId>(json.at("id"));
    cell.hash = content_hash_from_hex(json.at("hash"));
    cell.added = count(json, "added");
    cell.moved = count(json, "moved");
    cell.T_map_cell = pose_from_json(json.at("pose"));
    cell.session = json.at("session");
    cell.sequence = integer<std::uint32_t>(json.at("sequence"));
    cell.planes = integer<std::uint32_t>(json.at("planes"));
    cell.encoded_bytes = count(json, "bytes");
    return cell;
  });
}

Json to_json(const CellPage& page) {
  Json cells = Json::array();
  for (const CellRecord& cell : page.cells) cells.push_back(to_json(cell));
  return {{"revision", page.revision},
          {"cells", cells},
          {"next_cursor", page.next_cursor.empty() ? Json(nullptr) : Json(page.next_cursor)}};
}

CellPage cell_page_from_json(const Json& json) {
  return decoded("list of CELLs", [&] {
    CellPage page;
    page.revision = count(json, "revision");
    page.cells = list_of<CellRecord>(json.at("cells"), cell_record_from_json);
    if (!json.at("next_cursor").is_null()) page.next_cursor = json.at("next_cursor");
    return page;
  });
}

PutCellResult put_cell_result_from_json(const Json& json) {
  return decoded("CELL summary", [&] {
    return PutCellResult{cell_record_from_json(json), count(json, "revision"), false};
  });
}

Json to_json(const Session& session) {
  return {{"name", session.name},
          {"robot", session.robot},
          {"sensor", session.sensor},
          {"odometry_frame", session.odometry_frame},
          {"started", session.started > 0 ? Json(to_rfc3339(session.started)) : Json()},
          {"cells", session.cells},
          {"planes", session.planes},
          {"encoded_bytes", session.encoded_bytes},
          {"aligned", session.aligned},
          {"last_cell", session.last_cell ? Json(session.last_cell->value) : Json()},
          {"T_map_odom", session.T_map_odom ? to_json(*session.T_map_odom) : Json()}};
}

Session session_from_json(const Json& json) {
  return decoded("session", [&] {
    Session session;
    session.name = json.at("name");
    session.robot = json.at("robot");
    session.sensor = json.at("sensor");
    session.odometry_frame = json.at("odometry_frame");
    if (!json.at("started").is_null()) session.started = stamp_from_rfc3339(json.at("started"));
    session.aligned = json.at("aligned");
    session.cells = count(json, "cells");
    session.planes = count(json, "planes");
    session.encoded_bytes = count(json, "encoded_bytes");
    if (!json.at("last_cell").is_null()) session.last_cell = id<CellId>(json.at("last_cell"));
    if (!json.at("T_map_odom").is_null()) {
      session.T_map_odom = pose_from_json(json.at("T_map_odom"));
    }
    return session;
  });
}

SessionCell session_cell_from_json(const Json& json) {
  return decoded("CELL of a session", [&] {
    return SessionCell{put_cell_result_from_json(json), json.at("aligned").get<bool>()};
  });
}

ContentHash content_hash_from_json(const Json& json) {
  return decoded("content hash", [&] { return content_hash_from_hex(json); });
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

RegistrationScores scores_from_json(const Json& json) {
  return decoded("registration scores", [&] {
    RegistrationScores scores;
    scores.points = integer<std::uint32_t>(json.at("points"));
    scores.hits = integer<std::uint32_t>(json.at("hits"));
    scores.inlier_ratio_all = number_or(json, "inlier_ratio_all", 0);
    scores.inlier_ratio_hit = number_or(json, "inlier_ratio_hit", 0);
    scores.share_in_front = number_or(json, "share_in_front", 0);
    scores.share_beyond = number_or(json, "share_beyond", 0);
    scores.median_residual_m = number_or(json, "median_residual_m", 0);
    return scores;
  });
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

Constraint constraint_from_json(const Json& json) {
  return decoded("constraint", [&] {
    Constraint constraint;
    constraint.id = id<ConstraintId>(json.at("id"));
    constraint.from = id<CellId>(json.at("from"));
    constraint.to = id<CellId>(json.at("to"));
    constraint.T_from_to = pose_from_json(json.at("pose"));
    constraint.information = matrix_from_json(json.at("information"));
    constraint.kind = kind_from(json.at("kind"));
    constraint.origin = origin_from(json.at("origin"));
    constraint.scores = scores_from_json(json.at("scores"));
    constraint.weight = number_or(json, "weight", 1);
    constraint.pinned = json.value("pinned", false);
    return constraint;
  });
}

Json constraints_to_json(const std::vector<Constraint>& constraints) {
  Json list = Json::array();
  for (const Constraint& constraint : constraints) list.push_back(to_json(constraint));
  return list;
}

Changes changes_from_json(const Json& json) {
  return decoded("list of changes", [&] {
    Changes changes;
    changes.since = count(json, "since");
    changes.revision = count(json, "revision");
    changes.added = list_of<CellRecord>(json.at("added"), cell_record_from_json);
    for (const Json& moved : json.at("moved")) {
      changes.moved[id<CellId>(moved.at("id"))] = pose_from_json(moved.at("pose"));
    }
    changes.removed = list_of<CellId>(json.at("removed"), id<CellId>);
    for (const CellId cell : list_of<CellId>(json.value("unaligned", Json::array()), id<CellId>)) {
      changes.unaligned.insert(cell);
    }
    changes.added_constraints =
        list_of<Constraint>(json.at("added_constraints"), constraint_from_json);
    changes.removed_constraints =
        list_of<ConstraintId>(json.at("removed_constraints"), id<ConstraintId>);
    for (const Json& judged : json.value("judged", Json::array())) {
      changes.judged[id<ConstraintId>(judged.at("id"))] = {judged.at("weight").get<double>(),
                                                           judged.at("pinned").get<bool>()};
    }
    return changes;
  });
}

RevisionEvent revision_event_from_json(const Json& json) {
  return decoded("event of a revision", [&] {
    return RevisionEvent{count(json, "revision"), stamp_from_rfc3339(json.at("created"))};
  });
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

namespace {

void add_evidence(Json& json, const RelocalisationCandidate& candidate) {
  json["scores"] = to_json(candidate.registration.scores);
  json["confidence"] = candidate.confidence;
  json["similarity"] = candidate.similarity;
  json["dominance"] = candidate.dominance;
  json["witnesses"] = candidate.witnesses;
  json["residuals"] = {{"borders_m", ResidualHistogram::kBordersM},
                       {"points", candidate.residuals.points}};
}

/// A server of before these had none but the scores.
void read_evidence(const Json& json, RelocalisationCandidate& candidate) {
  candidate.registration.scores = scores_from_json(json.at("scores"));
  candidate.confidence = number_or(json, "confidence", 0);
  candidate.similarity = number_or(json, "similarity", 0);
  candidate.dominance = number_or(json, "dominance", 0);
  if (json.contains("witnesses")) {
    candidate.witnesses = integer<std::uint32_t>(json.at("witnesses"));
  }
  if (json.contains("residuals")) {
    const Json& points = json.at("residuals").at("points");
    for (std::size_t i = 0; i < candidate.residuals.points.size(); ++i) {
      candidate.residuals.points[i] = integer<std::uint32_t>(points.at(i));
    }
  }
}

}  // namespace

Json to_json(const Relocalisation& relocalisation) {
  const RelocalisationAnswer& answer = relocalisation.answer;
  Json json = {{"found", answer.found.has_value()}};
  if (answer.found) {
    json["T_map_scan"] = to_json(answer.found->T_map_scan);
    json["covariance"] = to_json(answer.covariance);
    json["cell"] = {{"id", answer.found->cell.value}};
    if (relocalisation.cell_hash) json["cell"]["hash"] = to_hex(*relocalisation.cell_hash);
    json["T_cell_scan"] = to_json(answer.found->T_cell_scan);
    if (relocalisation.geopose) json["geopose"] = to_json(*relocalisation.geopose);
    add_evidence(json, *answer.found);
    json["degenerate"] = answer.found->registration.degeneracy.degenerate;
  }
  json["alternatives"] = Json::array();
  for (const RelocalisationCandidate& other : answer.alternatives) {
    Json alternative{{"cell", other.cell.value},
                     {"T_map_scan", to_json(other.T_map_scan)},
                     {"accepted", other.accepted}};
    add_evidence(alternative, other);
    json["alternatives"].push_back(std::move(alternative));
  }
  json["cells_considered"] = answer.cells_considered;
  json["revision"] = relocalisation.revision;
  json["time_ms"] = relocalisation.time_ms;
  return json;
}

namespace {

RelocalisationCandidate found_from(const Json& json) {
  RelocalisationCandidate found;
  found.cell = id<CellId>(json.at("cell").at("id"));
  found.T_map_scan = pose_from_json(json.at("T_map_scan"));
  found.T_cell_scan = pose_from_json(json.at("T_cell_scan"));
  found.registration.T_target_source = found.T_cell_scan;
  found.registration.converged = true;
  read_evidence(json, found);
  found.registration.degeneracy.degenerate = json.at("degenerate");
  found.accepted = true;
  return found;
}

RelocalisationCandidate alternative_from(const Json& json) {
  RelocalisationCandidate other;
  const Json& cell = json.at("cell");
  other.cell = id<CellId>(cell.is_object() ? cell.at("id") : cell);
  other.T_map_scan = pose_from_json(json.at("T_map_scan"));
  read_evidence(json, other);
  other.accepted = json.at("accepted");
  return other;
}

}  // namespace

Relocalisation relocalisation_from_json(const Json& json) {
  return decoded("relocalisation answer", [&] {
    Relocalisation relocalisation;
    RelocalisationAnswer& answer = relocalisation.answer;
    if (json.at("found").get<bool>()) {
      answer.found = found_from(json);
      answer.covariance = matrix_from_json(json.at("covariance"));
      if (json.contains("geopose")) relocalisation.geopose = geopose_from(json.at("geopose"));
      relocalisation.cell_hash = content_hash_from_hex(json.at("cell").at("hash"));
    }
    answer.alternatives =
        list_of<RelocalisationCandidate>(json.at("alternatives"), alternative_from);
    answer.cells_considered = integer<std::size_t>(json.at("cells_considered"));
    relocalisation.revision = count(json, "revision");
    relocalisation.time_ms = json.at("time_ms");
    return relocalisation;
  });
}

Json to_json(const LoopList& list) {
  return {{"revision", list.revision}, {"loops", constraints_to_json(list.loops)}};
}

Json to_json(const ConstraintReport& report) {
  Json json = to_json(report.constraint);
  json["gap_m"] = report.gap_m;
  json["gap_deg"] = report.gap_deg;
  json["chi2"] = report.chi2;
  return json;
}

ConstraintReport constraint_report_from_json(const Json& json) {
  return decoded("report on a loop", [&] {
    ConstraintReport report;
    report.constraint = constraint_from_json(json);
    report.verdict = verdict(report.constraint);
    report.gap_m = json.at("gap_m").get<double>();
    report.gap_deg = json.at("gap_deg").get<double>();
    report.chi2 = json.at("chi2").get<double>();
    return report;
  });
}

LoopList loop_list_from_json(const Json& json) {
  return decoded("list of loops", [&] {
    return LoopList{count(json, "revision"),
                    list_of<Constraint>(json.at("loops"), constraint_from_json)};
  });
}

Json to_json(const LoopReport& report) {
  return {{"revision", report.revision},
          {"loops", constraints_to_json(report.loops)},
          {"moved", report.moved},
          {"initial_cost", report.initial_cost},
          {"final_cost", report.final_cost}};
}

LoopReport loop_report_from_json(const Json& json) {
  return decoded("report on loops", [&] {
    LoopReport report;
    report.revision = count(json, "revision");
    if (json.contains("loops")) {
      report.loops = list_of<Constraint>(json.at("loops"), constraint_from_json);
    }
    report.moved = json.contains("moved") ? count(json, "moved") : 0;
    report.initial_cost = number_or(json, "initial_cost", 0);
    report.final_cost = number_or(json, "final_cost", 0);
    return report;
  });
}

Json to_json(const Job& job) {
  const auto optional = [](const std::optional<double>& value) {
    return value ? Json(*value) : Json(nullptr);
  };
  Json error = nullptr;
  if (job.error_code) {
    error = {{"code", to_string(*job.error_code)}, {"message", job.error_message}};
  }
  return {{"id", job.id.value},
          {"map", job.map},
          {"kind", job.kind},
          {"state", to_string(job.state)},
          {"session", job.session.empty() ? Json() : Json(job.session)},
          {"scans_done", job.scans_done},
          {"scans_total", job.scans_total},
          {"cells_done", job.cells_done},
          {"progress", optional(job.progress)},
          {"scans_per_second", job.scans_per_second},
          {"eta_s", optional(job.eta_s)},
          {"next_scan", job.next_scan ? Json(*job.next_scan) : Json(nullptr)},
          {"error", error},
          {"created", to_rfc3339(job.created)},
          {"updated", to_rfc3339(job.updated)}};
}

Job job_from_json(const Json& json) {
  return decoded("job", [&] {
    const auto optional = [&](const char* key) -> std::optional<double> {
      const auto found = json.find(key);
      if (found == json.end() || found->is_null()) return std::nullopt;
      return found->get<double>();
    };
    const auto count_or_zero = [&](const char* key) {
      return json.contains(key) && !json.at(key).is_null() ? count(json, key) : 0;
    };
    Job job;
    job.id = id<JobId>(json.at("id"));
    job.map = json.at("map");
    job.kind = json.at("kind");
    job.state = job_state_from_string(json.at("state").get<std::string>());
    if (!json.at("session").is_null()) job.session = json.at("session");
    job.scans_done = count(json, "scans_done");
    job.scans_total = count_or_zero("scans_total");
    job.cells_done = count(json, "cells_done");
    job.progress = optional("progress");
    job.scans_per_second = number_or(json, "scans_per_second", 0);
    job.eta_s = optional("eta_s");
    if (json.contains("next_scan") && !json.at("next_scan").is_null()) {
      job.next_scan = count(json, "next_scan");
    }
    if (json.contains("error") && !json.at("error").is_null()) {
      job.error_code = error_code_from_string(json.at("error").at("code").get<std::string>());
      job.error_message = json.at("error").at("message");
    }
    job.created = stamp_from_rfc3339(json.at("created"));
    job.updated = stamp_from_rfc3339(json.at("updated"));
    return job;
  });
}

namespace {

std::string_view name_of(PoseFrame frame) {
  switch (frame) {
    case PoseFrame::kCamera:
      return "camera";
    case PoseFrame::kSensor:
      return "sensor";
    case PoseFrame::kAuto:
      break;
  }
  return "auto";
}

Json to_json(const IngestOptions& options) {
  Json json = Json::object();
  const auto set = [&](const char* key, const auto& value) {
    if (value) json[key] = *value;
  };
  set("cell_distance_m", options.cell_distance_m);
  set("min_range_m", options.min_range_m);
  set("max_range_m", options.max_range_m);
  set("vertical_angle_correction_deg", options.vertical_angle_correction_deg);
  set("bidirectional", options.bidirectional);
  set("loop_closures", options.loop_closures);
  if (options.loop_acceptance) json["loop_acceptance"] = to_string(*options.loop_acceptance);
  set("min_points", options.min_points);
  set("max_range_gap_m", options.max_range_gap_m);
  if (options.fit) json["fit"] = to_string(*options.fit);
  return json;
}

}  // namespace

Json to_json(const IngestRequest& request) {
  Json json = {{"kind", "ingest"}, {"create_map", request.create_map}};
  if (!request.session.empty()) json["session"] = request.session;
  if (request.path.empty()) {
    json["upload"] = true;
  } else {
    json["path"] = request.path;
    json["pose_frame"] = name_of(request.pose_frame);
  }
  if (!request.poses.empty()) json["poses"] = request.poses;
  if (request.scans_total > 0) json["scans_total"] = request.scans_total;
  if (request.lattice) {
    json["lattice"] = {{"kind", to_string(request.lattice->kind)}, {"size", request.lattice->size}};
  }
  if (Json options = to_json(request.options); !options.empty()) json["options"] = options;
  return json;
}

namespace {

ErrorCode code_of_status(int status) {
  switch (status) {
    case 404:
    case 410:
      return ErrorCode::kNotFound;
    case 405:
    case 406:
    case 415:
    case 501:
      return ErrorCode::kUnsupported;
    case 409:
      return ErrorCode::kConflict;
    case 412:
      return ErrorCode::kPreconditionFailed;
    case 413:
    case 414:
    case 431:
      return ErrorCode::kTooLarge;
    case 422:
      return ErrorCode::kCorruptData;
    case 408:
    case 429:
    case 502:
    case 503:
    case 504:
      return ErrorCode::kUnavailable;
    default:
      return status < 500 ? ErrorCode::kInvalidArgument : ErrorCode::kInternal;
  }
}

}  // namespace

Error problem_to_error(int status, std::string_view content_type, std::string_view body,
                       const std::string& what) {
  if (content_type.starts_with("application/problem+json")) {
    try {
      const Json problem = parse_json(body);
      const std::string name = problem.value("code", "");
      ErrorCode code = error_code_from_string(name);
      if (to_string(code) != name) code = code_of_status(status);
      const std::string detail = problem.value("detail", problem.value("title", ""));
      if (!detail.empty()) return Error(code, detail);
    } catch (const std::exception&) {
      // Not what it claims to be: the status has to do.
    }
  }
  return Error(code_of_status(status), what + " was answered with HTTP status " +
                                           std::to_string(status) +
                                           " and no explanation; is it a CELLmap server?");
}

}  // namespace cellmap::client
