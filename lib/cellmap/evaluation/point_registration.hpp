#pragma once

#include <cstddef>
#include <memory>

#include "cellmap/evaluation/nearest_points.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// A cloud made ready to be registered to by point-to-plane ICP: a normal at every point and a tree
/// over them. Immutable and safe to share between threads.
class PointTarget {
 public:
  /// `normals` of the same length as `points`, or empty: estimated from the points.
  PointTarget(PointCloud points, PointCloud normals, int threads);

  const PointCloud& points() const { return *points_; }
  const PointCloud& normals() const { return normals_; }
  const NearestPoints& tree() const { return tree_; }

 private:
  std::unique_ptr<const PointCloud> points_;  // stays where it is when the target moves
  PointCloud normals_;
  NearestPoints tree_;
};

/// The direction of least variance of each point's nearest neighbours, itself among them; unit
/// length, of either sign.
PointCloud estimate_normals(const PointCloud& points, std::size_t neighbours, int threads);

/// Point-to-plane ICP: as `register_scan`, with the same stages, gates, kernels and test of
/// convergence, but with the nearest point's plane where that one has the plane of the point's
/// direction. Not judged: only pose, convergence and iterations are filled in.
RegistrationResult register_to_points(const PointTarget& target, const PointCloud& scan,
                                      const Pose& T_target_scan_initial,
                                      const RegistrationOptions& options = {});

}  // namespace cellmap
