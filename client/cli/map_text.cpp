#include "client/cli/map_text.hpp"

#include <algorithm>

#include "client/cli/console.hpp"

namespace cellmap::cli {
namespace {

constexpr double kRawPointBytes = 16, kVoxelPointBytes = 12;

double ratio(double a, double b) { return b > 0 ? a / b : 0; }

std::string against(const char* what, std::uint64_t points, double bytes, double cell_bytes) {
  if (points == 0) return format("  %-14s not counted\n", what);
  const double times = ratio(bytes, cell_bytes);
  return format("  %-14s %s points, %s: %.2g times the CELLs as stored\n", what,
                with_commas(points).c_str(), human_bytes(bytes).c_str(), times);
}

/// "compact 20 mm", and what else there is where the map is being converted.
std::string kept_text(const MapInfo& map) {
  std::string text = to_string(map.form);
  if (map.kept.empty() || (map.kept.size() == 1 && map.kept.begin()->first == map.form)) {
    return text;
  }
  std::string parts;
  for (const auto& [form, cells] : map.kept) {
    parts += (parts.empty() ? "" : ", ") + with_commas(cells) + " " + to_string(form);
  }
  return text + " from now on (" + parts + ")";
}

}  // namespace

std::string map_line(const MapInfo& map) {
  return format("%-24s %7s CELLs  %9s stored as %s  revision %llu\n", map.name.c_str(),
                with_commas(map.cells).c_str(), human_bytes(double(map.stored_bytes)).c_str(),
                to_string(map.form).c_str(), static_cast<unsigned long long>(map.revision));
}

std::string session_line(const Session& session) {
  return format("%-24s %-16s %-12s %6s CELLs  %s\n", session.name.c_str(),
                session.robot.empty() ? "-" : session.robot.c_str(),
                session.sensor.empty() ? "-" : session.sensor.c_str(),
                with_commas(session.cells).c_str(),
                session.aligned ? "in the map frame" : "not aligned yet");
}

std::string map_text(const MapInfo& map) {
  std::string sessions;
  for (const std::string& session : map.sessions)
    sessions += (sessions.empty() ? "" : ", ") + session;
  const double cells = static_cast<double>(std::max<std::uint64_t>(map.cells, 1));
  std::string text = format("Map %s, revision %llu\n", map.name.c_str(),
                            static_cast<unsigned long long>(map.revision));
  text += format("  %-14s %s\n", "lattice", to_string(map.lattice).c_str());
  text +=
      format("  %-14s %s from %s scans (sessions: %s)\n", "CELLs", with_commas(map.cells).c_str(),
             with_commas(map.scans).c_str(), sessions.empty() ? "none" : sessions.c_str());
  text += format("  %-14s %s, %s a CELL\n", "planes", with_commas(map.planes).c_str(),
                 with_commas(static_cast<std::uint64_t>(double(map.planes) / cells)).c_str());
  text += format("  %-14s %s\n", "constraints", with_commas(map.constraints).c_str());
  text += format("  %-14s %s, %s a CELL\n", "FlatBuffers",
                 human_bytes(double(map.encoded_bytes)).c_str(),
                 human_bytes(double(map.encoded_bytes) / cells).c_str());
  text += format("  %-14s %s\n", "kept as", kept_text(map).c_str());
  text += format("  %-14s %s, %s a CELL\n", "stored", human_bytes(double(map.stored_bytes)).c_str(),
                 human_bytes(double(map.stored_bytes) / cells).c_str());
  const double stored = static_cast<double>(map.stored_bytes);
  text += against("raw scans", map.raw_points, double(map.raw_points) * kRawPointBytes, stored);
  text += against("0.4 m voxels", map.voxel_points, double(map.voxel_points) * kVoxelPointBytes,
                  stored);
  if (const auto& where = map.georeference) {
    text += format("  %-14s %.8f, %.8f deg, %.2f m\n", "origin", where->latitude_deg,
                   where->longitude_deg, where->height_m);
  }
  if (!map.bounds.isEmpty()) {
    const auto &low = map.bounds.min(), &high = map.bounds.max();
    text += format("  %-14s x %.1f to %.1f, y %.1f to %.1f, z %.1f to %.1f m\n", "bounds", low.x(),
                   high.x(), low.y(), high.y(), low.z(), high.z());
  }
  return text;
}

}  // namespace cellmap::cli
