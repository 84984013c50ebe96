#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// How a folder that the paper's released code wrote is read.
struct ReleasedFolderOptions {
  /// Its three bands; `size` is what that code calls param_ball_num.
  LatticeSpec lattice{LatticeKind::kFibonacciBands, 50'000};
  /// A CELL ends where a pose is farther than this from its base's: that code's base_gap.
  double cell_distance_m = 6.0;
  std::filesystem::path poses;  ///< of the scans, KITTI or TUM; empty: cell_odom.txt of the folder
  std::string session = "imported";

  /// Throws Error{kInvalidArgument} or {kUnsupported}.
  void validate() const;
};

struct ReleasedCell {
  Cell cell;
  std::vector<ScanInCell> scans;
  std::size_t dropped = 0;  ///< planes that no CELL may have (FORMAT.md, "CELL")
};

/// The map that the paper's released code leaves in a folder (FORMAT.md, "The released code's
/// folder"): cell_<n>.pcd and index_<n>.txt for each CELL, n = 0, 1, ..., and the poses of the
/// drive's scans. Which scan a CELL began with is not written there: it follows from the poses, as
/// that code has it. One CELL in memory at a time. The files are untrusted: time and memory are
/// bounded by their sizes, which are bounded.
class ReleasedFolder {
 public:
  /// Throws Error{kNotFound} where there is no folder, no CELL or no poses, {kCorruptData} where
  /// CELLs are not numbered from 0 on or the poses make another number of CELLs, {kTooLarge}.
  explicit ReleasedFolder(std::filesystem::path folder, const ReleasedFolderOptions& options = {});

  std::size_t size() const { return size_; }

  /// CELL `k` < size(). Normals come with the sign that a CELL asks for. Throws Error{kNotFound},
  /// {kCorruptData} naming file and line, {kUnsupported} for another kind of PCD, {kTooLarge}.
  ReleasedCell read(std::size_t k) const;

 private:
  void find_bases(std::size_t cells);

  std::filesystem::path folder_;
  ReleasedFolderOptions options_;
  Lattice lattice_;
  Trajectory poses_;
  std::size_t size_ = 0;
  std::vector<std::size_t> bases_;  ///< scan that each CELL begins with, and one after the last
};

}  // namespace cellmap
