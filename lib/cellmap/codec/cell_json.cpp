#include "cellmap/codec/cell_json.hpp"

#include <charconv>
#include <nlohmann/json.hpp>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {
namespace {

using Json = nlohmann::ordered_json;

/// The double whose shortest decimal form is that of the float: 0.1f becomes 0.1, not
/// 0.10000000149011612.
double shortest(float value) {
  char digits[32];
  const auto written = std::to_chars(digits, digits + sizeof(digits), value);
  double result = 0;
  std::from_chars(digits, written.ptr, result);
  return result;
}

Json planes_to_json(const Cell& cell) {
  Json planes = Json::array();
  for (const Plane& p : cell.planes) {
    planes.push_back(
        Json::array({shortest(p.distance_m), shortest(p.nx), shortest(p.ny), shortest(p.nz)}));
  }
  return planes;
}

Json statistics_to_json(const CellStatistics& s) {
  return {{"points", s.points},
          {"points_in_planes", s.points_in_planes},
          {"patches_hit", s.patches_hit},
          {"rejected_few_points", s.rejected_few_points},
          {"rejected_gap", s.rejected_gap},
          {"rejected_planarity", s.rejected_planarity},
          {"rejected_grazing", s.rejected_grazing}};
}

}  // namespace

std::string cell_to_json(const Cell& cell, const ContentHash& hash) {
  const Json json = {
      {"hash", to_hex(hash)},
      {"lattice", {{"kind", to_string(cell.lattice.kind)}, {"size", cell.lattice.size}}},
      {"session", cell.session},
      {"sequence", cell.sequence},
      {"T_odom_cell", to_xyz_qxyzw(cell.T_odom_cell)},
      {"first_stamp", cell.first_stamp},
      {"last_stamp", cell.last_stamp},
      {"first_scan", cell.first_scan},
      {"scan_count", cell.scan_count},
      {"statistics", statistics_to_json(cell.statistics)},
      {"indices", cell.indices},
      {"planes", planes_to_json(cell)}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string cell_to_json(const Cell& cell) { return cell_to_json(cell, encode_cell(cell).hash); }

}  // namespace cellmap
