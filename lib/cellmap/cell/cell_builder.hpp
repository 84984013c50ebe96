#pragma once

#include <memory>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

/// Builds the CELL of a local map while its scans arrive, so that less is left to do after the last
/// one: `build_cell` in two halves, with the same bytes. When a scan comes, its points are given to
/// patches, which is a third of the work.
///
/// With PlaneFit::kStreaming they are also added to the sums of their patches, and what is left is
/// to solve for the planes, without another look at the points. Use it where a CELL must be there
/// within milliseconds of its last scan; else the trimmed fit is the better one. A point is judged
/// by the planes of the points so far (patch_sums.hpp), so the first scans are trimmed less. On
/// CELLs of four full scans of KITTI 00, against the trimmed fit, residuals have the same rms, 75
/// to 89 % of the planes are kept (the others are thicker than max_thickness_ratio allows), and
/// registered neighbours move by 2 to 11 mm; with more scans a CELL it comes nearer. The bytes
/// depend on where scans begin, not on threads or the machine.
///
/// One owner.
class CellBuilder {
 public:
  /// Validates the options; `lattice` must outlive the builder.
  CellBuilder(const Lattice& lattice, const CellBuildOptions& options);
  ~CellBuilder();
  CellBuilder(CellBuilder&&) noexcept;
  CellBuilder& operator=(CellBuilder&&) noexcept;

  /// Takes in the points that `local_map`, which must always be the same one, has got since the
  /// last call. Linear in their number.
  void update(const LocalMap& local_map);

  /// The CELL of `local_map` (as `build_cell`), updated once more.
  Cell finish(const LocalMap& local_map);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
