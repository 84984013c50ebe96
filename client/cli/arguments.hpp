#pragma once

#include <array>
#include <string>

#include "cellmap/geometry/pose.hpp"

namespace cellmap::cli {

/// Reads exactly N finite numbers separated by spaces or commas. Throws Error{kInvalidArgument}
/// naming `option` and `expected`, for example "x y z qx qy qz qw".
template <std::size_t N>
std::array<double, N> parse_numbers(const std::string& option, const std::string& expected,
                                    const std::string& text);

/// "x y z qx qy qz qw" as a pose.
Pose parse_pose(const std::string& option, const std::string& text);

}  // namespace cellmap::cli
