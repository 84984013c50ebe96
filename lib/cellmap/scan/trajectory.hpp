#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// A pose of a moving frame at a time: T_parent_sensor.
struct StampedPose {
  Stamp stamp = 0;
  Pose pose = Pose::Identity();
};

/// Poses with strictly increasing stamps. Immutable, so safe to read from many threads.
class Trajectory {
 public:
  Trajectory() = default;
  /// Throws Error{kInvalidArgument} where stamps do not strictly increase or a pose is not rigid.
  explicit Trajectory(std::vector<StampedPose> poses);

  std::size_t size() const { return poses_.size(); }
  bool empty() const { return poses_.empty(); }
  const StampedPose& operator[](std::size_t i) const { return poses_[i]; }
  std::span<const StampedPose> poses() const { return poses_; }

  /// The pose at `stamp`: exact where a pose has that stamp, else interpolated between its
  /// neighbours along the geodesic; nullopt outside the covered time (never extrapolated).
  /// O(log n).
  std::optional<Pose> at(Stamp stamp) const;

  /// Metres travelled from the first pose to the last.
  double length_m() const;

 private:
  std::vector<StampedPose> poses_;
};

enum class TrajectoryFormat { kKitti, kTum };

/// Reads KITTI rows (12 numbers, row-major 3x4; row i gets stamps[i], or i * 0.1 s where `stamps`
/// is empty). Blank lines and lines that start with # are left out; rotations are projected to
/// SO(3). Throws Error{kNotFound} or {kIo} where the file cannot be read, {kCorruptData} naming
/// file and line where a row is malformed (not 12 finite numbers, not a rotation), or where there
/// are no rows or not as many as stamps; {kTooLarge} over 256 MiB.
Trajectory read_kitti_trajectory(const std::filesystem::path& file,
                                 std::span<const Stamp> stamps = {});

/// Reads TUM rows (stamp tx ty tz qx qy qz qw, stamp in seconds, read to the nanosecond; lines that
/// start with # are comments). Throws as above, and {kCorruptData} where times do not increase.
Trajectory read_tum_trajectory(const std::filesystem::path& file);

/// The format of a trajectory file by the number of columns of its first row. Throws as above.
TrajectoryFormat trajectory_format(const std::filesystem::path& file);

/// KITTI or TUM, told apart by the number of columns of the first row (12 or 8). `stamps` serve
/// KITTI rows only.
Trajectory read_trajectory(const std::filesystem::path& file, std::span<const Stamp> stamps = {});

/// The text of a trajectory in the given format: numbers read back as the same doubles, TUM stamps
/// are exact to the nanosecond. KITTI rows carry no stamps.
std::string to_text(const Trajectory& trajectory, TrajectoryFormat format);

/// Writes (or overwrites) `to_text` to a file. Throws Error{kIo}.
void write_trajectory(const std::filesystem::path& file, const Trajectory& trajectory,
                      TrajectoryFormat format);

}  // namespace cellmap
