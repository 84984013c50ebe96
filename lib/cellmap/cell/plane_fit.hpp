#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/point_runs.hpp"
#include "cellmap/simd/moments.hpp"
#include "cellmap/simd/plane_batch.hpp"

namespace cellmap {

/// The plane of a set of points and how well they agree with it.
struct FittedPlane {
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< unit, of either sign
  double variance_across_m2 = 0;                     ///< mean squared distance from the plane
  double variance_within_m2 = 0;                     ///< the smaller variance along the plane
  std::size_t points = 0;                            ///< points that took part
};

/// Moments of points about `origin`.
struct MomentsAbout {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  simd::Moments moments;
};

/// Total least squares planes: the eigenvector of the smallest eigenvalue of the covariance, in
/// closed form from basic arithmetic only, so that it has the same bits everywhere. Nothing where
/// the points do not span a plane (fewer than 3, or all on one line). Several at once cost a
/// quarter of what they cost one by one.
using FittedPlanes = std::span<std::optional<FittedPlane>>;
void fit_planes(std::span<const MomentsAbout> moments, FittedPlanes planes);
std::optional<FittedPlane> fit_plane(const PatchPoints& points);

/// Moments about their origin of the points farther from `plane` than `rms_factor` rms distances.
simd::Moments moments_off_plane(const PatchPoints& points, const FittedPlane& plane,
                                double rms_factor);

/// `fit_planes` of at most kPatchesAFit patches from the moments of all their points, repeated
/// twice over the points within `trim_rms_factor` rms of the last plane.
constexpr std::size_t kPatchesAFit = simd::PlaneBatch::kSize;
void fit_planes_trimmed(std::span<const PatchPoints> patches, std::span<const MomentsAbout> moments,
                        const CellBuildOptions& options, FittedPlanes planes);

/// The paper's fit: the plane through three drawn points that most points agree with, then
/// `fit_plane` over those. The draws depend on options.seed and `patch` only. Leaves those points
/// in `points`.
std::optional<FittedPlane> fit_plane_ransac(PatchPoints& points, const CellBuildOptions& options,
                                            std::uint32_t patch);

}  // namespace cellmap
