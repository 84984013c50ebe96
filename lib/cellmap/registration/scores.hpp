#pragma once

#include <span>

#include "cellmap/registration/residuals.hpp"

namespace cellmap {

/// A point within this distance of its plane is an inlier.
constexpr double kInlierDistanceM = 0.2;
/// A point farther than this in front of or behind its plane contradicts it.
constexpr double kContradictionDistanceM = 1.0;

/// The scores of the points of all terms together.
RegistrationScores scores_of(std::span<const HitDistances> terms);

/// Root mean square distance of the inliers of all terms.
double inlier_rmse_m(std::span<const HitDistances> terms);

}  // namespace cellmap
