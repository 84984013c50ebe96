#pragma once

#include <filesystem>
#include <vector>

#include "cellmap/cell/cell.hpp"

namespace cellmap {

/// The planes of a PCD file with the fields x y z intensity, all floats, ASCII or binary: normals
/// and distances as they stand there, whatever they are. Throws Error{kNotFound}, {kIo},
/// {kCorruptData} and {kUnsupported} with the file's name, {kTooLarge} for more than `max_planes`;
/// allocates nothing that the file's own size does not pay for.
std::vector<Plane> read_plane_pcd(const std::filesystem::path& file, std::size_t max_planes);

}  // namespace cellmap
