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

/// Poses with strictly increasing stamps. Immutable.
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
  /// neighbours; nullopt outside the covered time (never extrapolated).
  std::optional<Pose> at(Stamp stamp) const;

  /// Metres travelled from the first pose to the last.
  double length_m() const;

 private:
  std::vector<StampedPose> poses_;
};

enum class TrajectoryFormat { kKitti, kTum };

/// Reads KITTI rows (12 numbers, row-major 3x4; row i gets stamps[i], or i * 0.1 s where `stamps`
/// is empty). Throws Error{kIo} where the file cannot be read, Error{kCorruptData} naming file and
/// line where a row is malformed.
Trajectory read_kitti_trajectory(const std::filesystem::path& file, std::span<const Stamp> stamps = {});

/// Reads TUM rows (stamp tx ty tz qx qy qz qw, stamp in seconds; lines starting with # are comments).
Trajectory read_tum_trajectory(const std::filesystem::path& file);

/// KITTI or TUM, told apart by the number of columns of the first row (12 or 8).
Trajectory read_trajectory(const std::filesystem::path& file, std::span<const Stamp> stamps = {});

/// The text of a trajectory in the given format, full double precision (TUM stamps exact to the ns).
std::string to_text(const Trajectory& trajectory, TrajectoryFormat format);

}  // namespace cellmap
