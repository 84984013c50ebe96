#include "cellmap/document/json.hpp"

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace cellmap::document {
namespace {

Json vector3(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

}  // namespace

Json to_json(const Pose& pose) { return to_xyz_qxyzw(pose); }

Json to_json(const Matrix6d& symmetric) {
  Json json = Json::array();
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) json.push_back(symmetric(row, column));
  }
  return json;
}

Json to_json(const LatticeSpec& lattice) {
  return {{"kind", to_string(lattice.kind)}, {"size", lattice.size}};
}

Json to_json(const MapInfo& map) {
  constexpr std::uint64_t kRawPointBytes = 16, kVoxelPointBytes = 12;
  Json bounds = nullptr;
  if (!map.bounds.isEmpty()) {
    bounds = {{"min", vector3(map.bounds.min())}, {"max", vector3(map.bounds.max())}};
  }
  Json kept = Json::array();
  for (const auto& [form, cells] : map.kept) {
    kept.push_back(
        {{"encoding", to_string(form.encoding)}, {"bound_m", form.bound_m()}, {"cells", cells}});
  }
  return {{"name", map.name},
          {"encoding", to_string(map.form.encoding)},
          {"bound_m", map.form.bound_m()},
          {"kept", kept},
          {"lattice", to_json(map.lattice)},
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

Json to_json(const CellRecord& cell) {
  return {{"id", cell.id.value},       {"etag", '"' + to_hex(cell.hash) + '"'},
          {"hash", to_hex(cell.hash)}, {"added", cell.added},
          {"moved", cell.moved},       {"pose", to_json(cell.T_map_cell)},
          {"session", cell.session},   {"sequence", cell.sequence},
          {"planes", cell.planes},     {"bytes", cell.encoded_bytes}};
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

Json to_json(const ConstraintReport& report) {
  Json json = to_json(report.constraint);
  json["gap_m"] = report.gap_m;
  json["gap_deg"] = report.gap_deg;
  json["chi2"] = report.chi2;
  return json;
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

void add_evidence(Json& json, const RelocalisationCandidate& candidate) {
  json["scores"] = to_json(candidate.registration.scores);
  json["confidence"] = candidate.confidence;
  json["similarity"] = candidate.similarity;
  const SurroundingsScores& around = candidate.surroundings;
  json["surroundings"] = {{"cells", around.cells},
                          {"parts", around.parts},
                          {"agreement", around.agreement},
                          {"free_ratio", around.free_ratio}};
  json["residuals"] = {{"borders_m", ResidualHistogram::kBordersM},
                       {"points", candidate.residuals.points}};
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

}  // namespace cellmap::document
