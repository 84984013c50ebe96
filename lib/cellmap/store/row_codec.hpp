#pragma once

#include <span>

#include "cellmap/cell/local_map.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

// Values that a table keeps as bytes: little-endian IEEE doubles, so that what was committed comes
// back bit by bit. Readers throw Error{kCorruptData} for a wrong length or a value that no writer
// can have written.

/// 12 doubles: [R | t], row by row.
Bytes pose_to_bytes(const Pose& pose);
Pose pose_from_bytes(std::span<const std::byte> bytes);

/// 9 doubles: the rotation of a pose whose position has columns of its own, row by row.
Bytes rotation_to_bytes(const Pose& pose);
Pose pose_from_columns(const Eigen::Vector3d& position, std::span<const std::byte> rotation);

/// 36 doubles, row by row.
Bytes information_to_bytes(const Matrix6d& information);
Matrix6d information_from_bytes(std::span<const std::byte> bytes);

/// Two counts and five doubles.
Bytes scores_to_bytes(const RegistrationScores& scores);
RegistrationScores scores_from_bytes(std::span<const std::byte> bytes);

/// A record of stamp and pose for each scan.
Bytes scans_to_bytes(std::span<const ScanInCell> scans);
std::vector<ScanInCell> scans_from_bytes(std::span<const std::byte> bytes);

}  // namespace cellmap
