#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
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
  std::vector<VoxelBlock> voxels;  ///< all of those that its scans hit, in the odometry's frame

  const Cell& cell() const { return target->cell(); }
};

/// A CELL whose scans are elsewhere: its own points stand for them.
FinishedCell finished_without_scans(std::shared_ptr<const RegistrationTarget> target);

/// Counts the voxels of a session, CELL by CELL in order; stops at 15 million, which take about
/// 600 MB.
class SessionVoxels {
 public:
  SessionVoxels();
  /// FinishedCell::voxel_points of the next CELL, which hits these.
  std::uint64_t add(std::span<const VoxelBlock> voxels);

 private:
  VoxelCounter counter_;
};

/// Scans of one session in, CELLs out (paper, Sec. III-B): knows nothing of the map. One owner.
/// Where a drive is cut depends on its odometry alone (`cut_drive`), and but for `voxel_points` a
/// CELL depends on its own scans alone. Voxels at the seam count twice after `resume_after`.
class FrontEnd {
 public:
  FrontEnd(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice);

  /// Continues a session after its last CELL. The next scan to add is
  /// `last.first_scan + last.scan_count`.
  void resume_after(const Cell& last) { begin_at(last.sequence + 1); }
  /// The next scan to add is the first one of the CELL with this number in the session.
  void begin_at(std::uint32_t sequence) { next_sequence_ = sequence; }

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
  VoxelCounter voxels_;                 ///< of the scans of the local map, in odometry poses
  SessionVoxels session_voxels_;        ///< of finished CELLs
  std::uint32_t next_sequence_ = 0;
};

}  // namespace cellmap
