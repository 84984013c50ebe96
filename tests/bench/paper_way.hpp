#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"

/// The paper's own way, built anew from its text as the yardstick of the benchmark: a KD-tree over
/// the lattice, one growing vector and a RANSAC a patch, correspondences found anew in each
/// iteration, Jacobians by Eigen in double precision. Written to be fast within that design
/// (float tree, the best leaf size, gap test before RANSAC, as parallel as ours); never used by the
/// product.
namespace cellmap::bench {

/// The lattice as a point cloud on the unit sphere with its KD-tree (paper, Sec. III-B, step 1).
class LatticeTree {
 public:
  /// For queries in scan order leaf sizes of 5 and 10 are equally fast; 2, 20 and 40 are slower.
  explicit LatticeTree(const Lattice& lattice, std::size_t leaf_size = 10);
  ~LatticeTree();

  std::uint32_t size() const { return static_cast<std::uint32_t>(directions_.size()); }
  const Eigen::Vector3f& direction(std::uint32_t index) const { return directions_[index]; }

  /// Projects the point to the unit sphere and looks for the nearest lattice point, in float.
  std::uint32_t nearest(const Eigen::Vector3f& point) const;
  void nearest(const PointCloud& cloud, std::span<std::uint32_t> indices, int threads) const;

 private:
  struct Tree;
  std::vector<Eigen::Vector3f> directions_;
  std::unique_ptr<Tree> tree_;
};

/// N x 4 numbers (paper, Sec. III-B, step 4); a zero normal where the patch has no plane.
struct PaperCell {
  std::vector<Plane> planes;  ///< one a lattice point

  std::size_t valid() const;
};

PaperCell to_paper_cell(const Cell& cell);

/// Steps 2 to 4 of Sec. III-B: a 3 m gap, 6 points, 30 draws with 0.1 m for inliers, then a least
/// squares plane over the inliers.
PaperCell build_cell_paper_way(const PointCloud& local_map, const LatticeTree& tree, int threads);

/// One direction of a registration, as `RegistrationTerm`: forward moves the scan by T, reverse by
/// its inverse.
struct PaperTerm {
  const PaperCell* cell;
  const PointCloud* scan;
  bool reverse = false;
};

enum class JacobianSize {
  kDynamic,  ///< Eigen matrices of dynamic size, one a point, as is usual in published code
  kFixed,    ///< the same with sizes known to the compiler: the best that this design can do
};

struct PaperRegistration {
  int iterations = 4;
  double gate_m = 3.0;  ///< the text names none; without any, one far plane decides the pose
  int threads = 1;
  JacobianSize jacobians = JacobianSize::kDynamic;
};

/// Sec. III-C: all points, all directions in one Gauss-Newton system, left perturbation.
Pose register_paper_way(std::span<const PaperTerm> terms, const LatticeTree& tree,
                        const Pose& T_initial, const PaperRegistration& options);

/// Share of all points of a scan within 0.2 m of their plane.
double inlier_ratio_paper_way(const PaperTerm& term, const LatticeTree& tree, const Pose& T,
                              int threads);

}  // namespace cellmap::bench
