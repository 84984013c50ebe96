#pragma once

#include <numbers>

namespace cellmap {

/// Options and reports are in degrees, everything else in radians.
inline constexpr double kRadPerDeg = std::numbers::pi / 180;
inline constexpr double kDegPerRad = 180 / std::numbers::pi;

}  // namespace cellmap
