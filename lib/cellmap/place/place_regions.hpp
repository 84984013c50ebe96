#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// A square of the ground plane, kRegionSideM to a side: its column and row.
struct RegionKey {
  std::int32_t x = 0, y = 0;
  auto operator<=>(const RegionKey&) const = default;
};

/// In a city some 300 CELLs a region (streets 100 m apart, a CELL every 6.4 m), 0.4 MB of
/// described places: few enough to be read for one query with a prior, and so many that a million
/// CELLs are some 4,000 parts.
constexpr double kRegionSideM = 256.0;

/// Where the CELLs of a pose graph lie, by region. A CELL lies in one, that of its position; when
/// poses change, the regions are made anew (0.3 s for a million CELLs). Immutable; 32 bytes a CELL.
class PlaceRegions {
 public:
  struct Region {
    RegionKey key;
    std::vector<CellId> ids;                 ///< ascending
    std::vector<Eigen::Vector3d> positions;  ///< of each
  };

  PlaceRegions() = default;
  explicit PlaceRegions(const PoseGraph& graph);
  /// Of the CELLs that `holds`, which is asked in order of id, says yes to.
  PlaceRegions(const PoseGraph& graph, const std::function<bool(CellId)>& holds);

  const std::vector<Region>& all() const { return regions_; }  ///< by key; none is empty
  std::size_t cells() const { return cells_; }
  /// nullptr where there is no CELL.
  const Region* find(const RegionKey& key) const;

  /// The CELLs not farther than that from a place, on the ground plane.
  PlaceRegions within(const Eigen::Vector2d& centre, double radius_m) const;

 private:
  std::vector<Region> regions_;
  std::size_t cells_ = 0;
};

/// Names which CELLs lie in a region, so that others can tell whether they know it as it is.
std::uint64_t checksum_of_cells(const PlaceRegions::Region& region);

}  // namespace cellmap
