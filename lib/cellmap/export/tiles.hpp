#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// A point cloud map in square tiles as Autoware reads it: a folder of "X_Y.pcd" (binary PCD with
/// normals, points in the map frame), X and Y a tile's lower corner in metres, and
/// "pointcloud_map_metadata.yaml" with x_resolution, y_resolution and the corner of each file.
/// Written while points come: they wait in memory until there are `kWaitingPoints`, then go to the
/// ends of their files. One owner.
class TileWriter {
 public:
  static constexpr std::size_t kWaitingPoints = 2'000'000;

  /// `folder` is made, and must hold no metadata yet, else Error{kAlreadyExists}. Tiles of a whole
  /// number of metres, at least one, else Error{kInvalidArgument}.
  TileWriter(const std::filesystem::path& folder, double tile_m);

  /// Throws Error{kIo}.
  void add(const PointCloud& points, const PointCloud& normals);
  /// Writes headers and metadata: only now the folder is a map. Throws Error{kIo}.
  void finish();

  std::uint64_t points() const { return points_; }
  std::size_t tiles() const { return tiles_.size(); }

 private:
  using Corner = std::pair<std::int64_t, std::int64_t>;  // in tiles
  struct Tile {
    PointCloud points, normals;  // that wait
    std::uint64_t written = 0;
  };
  std::filesystem::path file_of(const Corner& corner) const;
  std::string name_of(const Corner& corner) const;
  void write_waiting();

  std::filesystem::path folder_;
  std::int64_t tile_m_;
  std::map<Corner, Tile> tiles_;
  std::uint64_t points_ = 0;
  std::size_t waiting_ = 0;
};

}  // namespace cellmap
