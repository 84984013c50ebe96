#include "cellmap/export/tiles.hpp"

#include <cmath>
#include <fstream>

#include "cellmap/core/error.hpp"
#include "cellmap/export/point_file.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr char kMetadata[] = "pointcloud_map_metadata.yaml";

[[noreturn]] void fail(const fs::path& file) {
  throw Error(ErrorCode::kIo, file.string() + ": cannot be written; is there space?");
}

}  // namespace

TileWriter::TileWriter(const fs::path& folder, double tile_m)
    : folder_(folder), tile_m_(static_cast<std::int64_t>(tile_m)) {
  if (!(tile_m >= 1 && tile_m <= 100'000) || static_cast<double>(tile_m_) != tile_m) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected tiles of a whole number of metres from 1 to 100,000");
  }
  std::error_code failed;
  fs::create_directories(folder_, failed);
  if (failed) throw Error(ErrorCode::kIo, folder_.string() + ": the folder cannot be made");
  if (fs::exists(folder_ / kMetadata)) {
    throw Error(ErrorCode::kAlreadyExists,
                folder_.string() + " holds tiles already; name another folder");
  }
}

std::string TileWriter::name_of(const Corner& corner) const {
  return std::to_string(corner.first * tile_m_) + "_" + std::to_string(corner.second * tile_m_) +
         ".pcd";
}

fs::path TileWriter::file_of(const Corner& corner) const { return folder_ / name_of(corner); }

void TileWriter::add(const PointCloud& points, const PointCloud& normals) {
  const auto tile = [&](float v) {
    return static_cast<std::int64_t>(std::floor(v / static_cast<double>(tile_m_)));
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    Tile& home = tiles_[{tile(points.x[i]), tile(points.y[i])}];
    home.points.push_back(points[i]);
    home.normals.push_back(normals[i]);
  }
  points_ += points.size();
  waiting_ += points.size();
  if (waiting_ >= kWaitingPoints) write_waiting();
}

void TileWriter::write_waiting() {
  for (auto& [corner, tile] : tiles_) {
    if (tile.points.empty()) continue;
    const bool is_new = tile.written == 0;
    std::ofstream out(file_of(corner),
                      std::ios::binary | (is_new ? std::ios::trunc : std::ios::app));
    if (is_new) out << pcd_header(0);
    out << float_rows(tile.points, tile.normals);
    out.close();
    if (!out) fail(file_of(corner));
    tile.written += tile.points.size();
    tile.points = tile.normals = {};
  }
  waiting_ = 0;
}

void TileWriter::finish() {
  write_waiting();
  const std::string resolution = std::to_string(tile_m_) + ".0\n";
  std::string metadata = "x_resolution: " + resolution + "y_resolution: " + resolution;
  for (const auto& [corner, tile] : tiles_) {
    std::fstream out(file_of(corner), std::ios::binary | std::ios::in | std::ios::out);
    out << pcd_header(tile.written);
    out.close();
    if (!out) fail(file_of(corner));
    metadata += name_of(corner) + ": [" + std::to_string(corner.first * tile_m_) + ", " +
                std::to_string(corner.second * tile_m_) + "]\n";
  }
  std::ofstream out(folder_ / kMetadata, std::ios::binary | std::ios::trunc);
  out << metadata;
  out.close();
  if (!out) fail(folder_ / kMetadata);
}

}  // namespace cellmap
