#pragma once

#include <filesystem>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap::pcl_io {

/// Reads the x, y, z fields of a PCD or PLY file (ASCII, binary or compressed). Fits
/// `cellmap::ScanFileReader`. Throws Error{kIo} or Error{kCorruptData} saying which field is missing.
PointCloud read_scan_file(const std::filesystem::path& file);

/// Writes points (and normals, where given: same length) as binary PCD or PLY, by extension.
void write_cloud(const std::filesystem::path& file, const PointCloud& points,
                 const PointCloud* normals = nullptr);

}  // namespace cellmap::pcl_io
