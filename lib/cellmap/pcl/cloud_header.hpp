#pragma once

#include <filesystem>

namespace cellmap::pcl_io {

/// PCL allocates what a header announces and reads what it can. A header is untrusted input, so
/// these checks come first: they pass only files whose header is well-formed and unambiguous, holds
/// x, y and z as float or double, announces 1 to `kMaxPoints` points, and is followed by at least
/// the bytes it announces. Throw Error{kCorruptData}, {kUnsupported}, {kTooLarge} or {kIo} naming
/// the file, what was expected and what was found.

/// The same limit as for KITTI scans (scan/scan_source.hpp).
constexpr std::size_t kMaxPoints = 2'000'000;

/// PCD 0.6 and 0.7. ASCII rows, here and in PLY, are checked to the last number.
void check_pcd(const std::filesystem::path& file);

/// PLY 1.0, ASCII and binary of both byte orders, without lists (faces) and without range grids.
void check_ply(const std::filesystem::path& file);

}  // namespace cellmap::pcl_io
