#pragma once

#include <filesystem>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap::pcl_io {

/// Reads the x, y, z fields of a PCD or PLY file (ASCII, binary or compressed; float or double),
/// points as they are (NaN included); PCD's VIEWPOINT and PLY's camera are not applied. Fits
/// `cellmap::ScanFileReader`. The header is not trusted: counts are held against the file's size
/// before anything is allocated. Throws, naming file and line, Error{kNotFound}, {kIo}, {kTooLarge}
/// over 2,000,000 points, {kUnsupported} for other extensions, integer coordinates, meshes and
/// range grids, {kCorruptData} where a field is missing or the data is cut off or damaged. Not
/// thread safe: PCL's console is muted meanwhile, and that is a global of PCL's.
PointCloud read_scan_file(const std::filesystem::path& file);

/// Writes (or overwrites) points, and normals where given (same length), as binary little-endian
/// PCD or PLY, by extension. Throws Error{kInvalidArgument} for another extension, no points or
/// another number of normals, {kIo}. Not thread safe, as above.
void write_cloud(const std::filesystem::path& file, const PointCloud& points,
                 const PointCloud* normals = nullptr);

}  // namespace cellmap::pcl_io
