#pragma once

#include <array>
#include <cstdint>

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// A pose as whole steps of a fixed grid: what a moved CELL's pose is on a thin link (FORMAT.md,
/// "Changes"). Coordinates are absolute, so the error of a pose does not depend on the poses that
/// were sent before it: it is one rounding, however many updates a reader has applied.
///
/// Rotations are modified Rodrigues parameters q_v / (1 + q_w) of the unit quaternion with
/// q_w >= 0: three numbers within [-1, 1], smooth everywhere but at half a turn, and back to a
/// matrix with + - * / alone (Shuster, "A survey of attitude representations", 1993).
struct GridPose {
  std::array<std::int64_t, 3> translation{};  ///< in steps of kGridTranslationStep_m
  std::array<std::int64_t, 3> rotation{};     ///< in steps of kGridRotationStep
  bool operator==(const GridPose&) const = default;
};

constexpr double kGridTranslationStep_m = 1.0 / 8192;    ///< 2^-13: 0.122 mm
constexpr double kGridRotationStep = 1.0 / 4194304;      ///< 2^-22
constexpr std::int64_t kMaxGridTranslation = 1ll << 37;  ///< 2^24 m
constexpr std::int64_t kMaxGridRotation = 1ll << 22;

/// A pose moves by at most this when it is put on the grid.
constexpr double kGridTranslationError_m = 1.06e-4;  ///< half a step along each axis, sqrt(3) / 2
constexpr double kGridRotationError_rad = 8.3e-7;    ///< 4 times half a step, times sqrt(3)

/// The nearest pose of the grid. Throws Error{kCorruptData} where the pose is not rigid or further
/// than 2^24 m from the origin.
GridPose to_grid(const Pose& T);

/// The pose of grid coordinates within the two limits above: the same bits on every machine.
Pose from_grid(const GridPose& grid);

}  // namespace cellmap
