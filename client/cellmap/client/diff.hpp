#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/change/diff.hpp"
#include "cellmap/client/client.hpp"

namespace cellmap {

/// Which sessions of a map are compared, and where.
struct DiffRequest {
  std::array<std::string, 2> sessions;  ///< the earlier one first
  std::optional<Eigen::Vector3d> near;  ///< with `radius_m` > 0: only CELLs there take part
  double radius_m = 0;
  bool patches = false;  ///< whether each CELL names its changed patches
};

/// How many patches of a CELL became what.
struct CellChangeCounts {
  CellId cell;
  std::string session;
  std::uint64_t stayed = 0, vanished = 0, appeared = 0, never_seen = 0;
  std::vector<std::uint32_t> changed;  ///< lattice points, ascending; where they were asked for
};

/// What changed between two sessions of a map (change/diff.hpp).
struct MapDiff {
  Revision revision = 0;  ///< whose poses were used
  std::array<std::string, 2> sessions;
  std::uint64_t pairs = 0;
  std::vector<ChangeRegion> regions;
  std::vector<CellChangeCounts> cells;  ///< of the earlier session, then of the later one
  double time_ms = 0;
};

/// Asks the server of `options`, on a connection of its own. Errors as those of `Client`; kNotFound
/// for a session that is not there, kConflict for one that is not aligned, kTooLarge where a part
/// of the map must be named.
MapDiff diff_sessions(const ClientOptions& options, const std::string& map,
                      const DiffRequest& request);

/// The same from CELLs at hand.
MapDiff to_map_diff(const SessionDiff& diff, const DiffRequest& request, Revision revision);

}  // namespace cellmap
