#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

enum class PointFormat {
  kPly,  ///< PLY 1.0, binary little-endian: x, y, z, nx, ny, nz as float
  kPcd,  ///< PCD 0.7, binary: x, y, z, normal_x, normal_y, normal_z as float
  kLas,  ///< LAS 1.2, point format 0: x, y, z to a millimetre; no normals
};

/// By the name's extension, .ply, .pcd or .las. Throws Error{kInvalidArgument}.
PointFormat point_format_of(const std::filesystem::path& file);

/// A point cloud that is written while its points come, so that it may be larger than memory: the
/// header, which tells how many there are, is written again at the end. Until then the file has the
/// name with ".part" behind it. One owner.
class PointFileWriter {
 public:
  /// Begins the file. Throws Error{kIo}.
  PointFileWriter(const std::filesystem::path& file, PointFormat format);
  /// Removes what was not finished.
  ~PointFileWriter();
  PointFileWriter(const PointFileWriter&) = delete;
  PointFileWriter& operator=(const PointFileWriter&) = delete;

  /// Appends points with their normals (same length). Throws Error{kIo}; {kTooLarge} where LAS has
  /// no more room (4,294,967,295 points, 2,147 km from the origin).
  void add(const PointCloud& points, const PointCloud& normals);
  /// Writes the header and gives the file its name. Throws Error{kIo}.
  void finish();

  std::uint64_t points() const { return points_; }

 private:
  std::string header() const;

  std::filesystem::path file_, part_;
  PointFormat format_;
  std::ofstream out_;
  std::uint64_t points_ = 0;
  std::array<double, 3> low_, high_;
  bool finished_ = false;
};

/// Header of a PCD file of as many points with normals; always of the same length.
std::string pcd_header(std::uint64_t points);

/// The bytes of points and normals as they stand in PCD and PLY: six floats each.
std::string float_rows(const PointCloud& points, const PointCloud& normals);

}  // namespace cellmap
