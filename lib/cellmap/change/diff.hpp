#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <stop_token>
#include <string_view>
#include <vector>

#include "cellmap/change/diff_options.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/place/loop_detection.hpp"

namespace cellmap {

/// What became of a patch (a plane of a CELL) between two sessions. "Gone" and "new" are the same
/// finding seen from either side: a patch that the other session looked through.
enum class PatchChange : std::uint8_t {
  kNeverSeen,  ///< the other session cannot tell: hidden, out of range, grazed, or not clear
  kStayed,     ///< at least one CELL of the other session has the surface too
  kVanished,   ///< of the earlier session: the later one looked through where it was
  kAppeared,   ///< of the later session: the earlier one looked through where it is
};
std::string_view to_string(PatchChange change);  ///< "never_seen", "stayed", "vanished", "appeared"

/// A CELL where it lies now.
struct PlacedCell {
  CellId id;
  Pose T_map_cell = Pose::Identity();
};

/// What became of the patches of one CELL.
struct CellDiff {
  CellId cell;
  std::vector<PatchChange> patches;    ///< one a plane, in the order of its planes
  std::vector<std::uint32_t> changed;  ///< lattice points of those that vanished or appeared

  std::size_t count(PatchChange change) const;
};

/// A place where patches changed: a car that is gone, a skip that is new.
struct ChangeRegion {
  PatchChange change = PatchChange::kVanished;
  Eigen::AlignedBox3d box;                             ///< of its patches' middles, map frame
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();  ///< of them, map frame
  std::uint32_t patches = 0;                           ///< of all CELLs that saw it
  double area_m2 = 0;         ///< of the patches of the CELL that saw most of it
  std::vector<CellId> cells;  ///< that saw it, ascending
};

/// How two sessions of one map differ.
struct SessionDiff {
  std::vector<CellDiff> earlier, later;  ///< one for each CELL, in the order given
  std::vector<ChangeRegion> regions;     ///< vanished ones first, the largest area first
  std::size_t pairs = 0;                 ///< of CELLs that were compared
};

/// The pairs of CELLs that `diff_sessions` compares, as positions in the two lists: each CELL with
/// the nearest of the other session within reach. O(earlier x later).
struct CellPair {
  std::size_t earlier = 0, later = 0;
};
std::vector<CellPair> pairs_to_compare(std::span<const PlacedCell> earlier,
                                       std::span<const PlacedCell> later,
                                       const DiffOptions& options);

/// Compares the CELLs of one session with those of another by sight lines: each patch is looked for
/// by the CELLs of the other session around it. One confirmation outweighs every look through;
/// a patch is gone where nobody confirms it and it was looked through from a clear view
/// (`DiffOptions`). All poses in one frame: sessions that are not aligned cannot be compared.
///
/// `targets` is called by this thread only and may load; up to 2 * views + 1 CELLs are held.
/// Deterministic for any thread count. About 10 ms a pair. Throws Error{kInvalidArgument} for
/// options, {kCancelled}, and what `targets` throws.
SessionDiff diff_sessions(std::span<const PlacedCell> earlier, std::span<const PlacedCell> later,
                          const TargetProvider& targets, const DiffOptions& options = {},
                          const std::stop_token& stop = {});

}  // namespace cellmap
