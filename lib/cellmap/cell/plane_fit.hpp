#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "cellmap/cell/build_cell.hpp"

namespace cellmap {

/// A point of a patch, cell frame.
using PatchPoint = Eigen::Vector3f;

/// The plane of a set of points and how well they agree with it.
struct FittedPlane {
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< unit, of either sign
  double variance_across_m2 = 0;                     ///< mean squared distance from the plane
  double variance_within_m2 = 0;                     ///< the smaller variance along the plane
  std::size_t points = 0;                            ///< points that took part
};

/// Total least squares plane of the points: the eigenvector of the smallest eigenvalue of their
/// covariance, in closed form from basic arithmetic only, so that it has the same bits everywhere.
/// Nothing where the points do not span a plane (fewer than 3, or all on one line).
std::optional<FittedPlane> fit_plane(std::span<const PatchPoint> points);

/// `fit_plane`, repeated twice over the points within `trim_rms_factor` rms of the last plane.
/// Reorders `points`: those that took part come first.
std::optional<FittedPlane> fit_plane_trimmed(std::span<PatchPoint> points,
                                             const CellBuildOptions& options);

/// The paper's fit: the plane through three drawn points that most points agree with, then
/// `fit_plane` over those. The draws depend on options.seed and `patch` only. Reorders `points`.
std::optional<FittedPlane> fit_plane_ransac(std::span<PatchPoint> points,
                                            const CellBuildOptions& options, std::uint32_t patch);

}  // namespace cellmap
