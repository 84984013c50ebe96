#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/simd/moments.hpp"

namespace cellmap {

/// A point of a patch, cell frame.
using PatchPoint = simd::PatchPoint;
inline Eigen::Vector3d position(const PatchPoint& p) { return {p.x, p.y, p.z}; }

/// The points of one patch about the first of them, which is where moments are taken: a patch is
/// small beside its distance. Reused from patch to patch.
class CentredPatch {
 public:
  /// `points` must not be empty.
  void assign(std::span<const PatchPoint> points);

  const Eigen::Vector3d& origin() const { return origin_; }
  simd::CentredPoints points() const { return {x_.data(), y_.data(), z_.data(), count_}; }
  double min_range_m() const { return std::sqrt(squared_ranges_.min); }
  double max_range_m() const { return std::sqrt(squared_ranges_.max); }

 private:
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::size_t count_ = 0;
  simd::SquaredRanges squared_ranges_{0, 0};
  std::vector<double> x_, y_, z_;
};

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
std::optional<FittedPlane> fit_plane_trimmed(const CentredPatch& patch,
                                             const CellBuildOptions& options);

/// The paper's fit: the plane through three drawn points that most points agree with, then
/// `fit_plane` over those. The draws depend on options.seed and `patch` only. Reorders `points`.
std::optional<FittedPlane> fit_plane_ransac(std::span<PatchPoint> points,
                                            const CellBuildOptions& options, std::uint32_t patch);

}  // namespace cellmap
