#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

/// What the rules ask of a patch beside its plane.
struct PatchExtent {
  std::uint32_t index = 0;
  std::uint32_t points = 0;
  double min_range_m = 0, max_range_m = 0;
};

/// A stretch of a CELL: the planes of some neighbouring lattice points.
struct CellPart {
  std::vector<std::uint32_t> indices;
  std::vector<Plane> planes;
  CellStatistics statistics;

  void append(const CellPart& other);
};

/// Decides which planes a CELL keeps (paper, Sec. III-B, steps 3 and 4), and counts.
class PlaneRules {
 public:
  PlaneRules(const Lattice& lattice, const CellBuildOptions& options);

  /// A patch with any points comes first to `has_enough_points`; where that says no, it is done.
  bool has_enough_points(std::uint32_t points, CellPart& part) const;
  void reject_gap(CellPart& part) const { ++part.statistics.rejected_gap; }
  /// Patches come in the order of their indices.
  void judge(const PatchExtent& patch, const std::optional<FittedPlane>& fitted,
             CellPart& part) const;

 private:
  bool is_planar(const FittedPlane& fitted) const;
  /// Where the ray of the patch meets the plane; nothing where it grazes.
  std::optional<Plane> plane_on_ray(const PatchExtent& patch, const FittedPlane& fitted) const;

  const Lattice& lattice_;
  const CellBuildOptions& options_;
  double max_tangent2_;  ///< of the normal's error
  double min_towards_;   ///< sine of the grazing angle
};

}  // namespace cellmap
