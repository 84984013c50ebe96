#pragma once

#include <cstddef>
#include <memory>

#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// Scans [first, first + count) of a drive as a drive of its own: numbered from 0, with odometry
/// that begins at the identity; `count` 0: to the end. Ground truth is that of the part, in the
/// world's frame. Throws Error{kInvalidArgument} where the drive ends before `first`.
std::unique_ptr<ScanSource> part_of_drive(std::unique_ptr<ScanSource> drive, std::size_t first,
                                          std::size_t count);

}  // namespace cellmap
