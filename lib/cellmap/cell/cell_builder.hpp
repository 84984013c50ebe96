#pragma once

#include <memory>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

/// Builds the CELL of a local map while its scans arrive, so that little is left to do after the
/// last one: `build_cell` in two halves, with the same bytes. What is done at once, for each scan:
///   every fit        its points are given to patches
///   kMoments         and added to what is kept of each patch; nothing is left but to solve
/// With PlaneFit::kMoments a CELL is ready some 2 ms after its last scan of 120,000 points, with
/// the others it takes two thirds of the time of `build_cell`. One owner.
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
