#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/geometry/voxel_grid.hpp"
#include "cellmap/pipeline/mapper_options.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// A CELL that is not in a map yet, ready to be registered.
struct FinishedCell {
  std::shared_ptr<const RegistrationTarget> target;
  /// What registers it to others, in its frame: its base scan, or its reconstructed points where no
  /// scan was kept.
  PointCloud points;
  std::vector<ScanInCell> scans;  ///< its stretch of the drive; empty where unknown
  std::uint64_t raw_points = 0;   ///< of its scans before filtering
  /// 0.4 m voxels that the session hit here first: what a voxel-downsampled map of it would grow
  /// by.
  std::uint64_t voxel_points = 0;

  const Cell& cell() const { return target->cell(); }
};

/// A CELL whose scans are elsewhere: its own points stand for them.
FinishedCell finished_without_scans(std::shared_ptr<const RegistrationTarget> target);

/// Scans of one session in, CELLs out (paper, Sec. III-B): knows nothing of the map. One owner.
/// Voxels at the seam count twice after `resume_after`; counting stops at 15 million, which take
/// about 600 MB.
class FrontEnd {
 public:
  FrontEnd(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice);

  /// Continues a session after its last CELL. The next scan to add is
  /// `last.first_scan + last.scan_count`.
  void resume_after(const Cell& last) { next_sequence_ = last.sequence + 1; }

  /// Adds the next scan; returns the CELL that it completed, if it did.
  std::optional<FinishedCell> add(const PosedScan& scan);

  /// Ends the drive: the CELL of the scans since the last one, if there are any.
  std::optional<FinishedCell> finish();

 private:
  FinishedCell make_cell();

  MapperOptions options_;
  std::string session_;
  std::shared_ptr<const Lattice> lattice_;
  std::optional<LocalMap> local_map_;
  std::optional<CellBuilder> builder_;  ///< of the local map
  std::uint64_t raw_points_ = 0;        ///< of the scans of the local map
  VoxelCounter voxels_;                 ///< of all scans, in odometry poses
  std::size_t counted_voxels_ = 0;      ///< of finished CELLs
  std::uint32_t next_sequence_ = 0;
};

}  // namespace cellmap
