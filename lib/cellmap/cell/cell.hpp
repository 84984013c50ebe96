#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// One plane of a CELL: the plane meets the ray of its lattice point at `distance_m`, so the point
/// distance_m * direction(index) lies on it. The paper's four numbers (Sec. III-B, step 4).
struct Plane {
  float distance_m = 0;          ///< along the lattice direction, > 0
  float nx = 0, ny = 0, nz = 0;  ///< unit normal towards the CELL's origin: n . direction < 0
  bool operator==(const Plane&) const = default;
};
static_assert(sizeof(Plane) == 16, "a Plane is a float4 on disk and on the wire");

/// How a CELL came to be. Counts only: nothing here depends on time or thread count.
struct CellStatistics {
  std::uint64_t points = 0;            ///< points of the local map that were segmented
  std::uint64_t points_in_planes = 0;  ///< of these, points in patches that kept a plane
  std::uint32_t patches_hit = 0;       ///< patches with at least one point
  std::uint32_t rejected_few_points = 0;
  std::uint32_t rejected_gap = 0;
  std::uint32_t rejected_planarity = 0;
  std::uint32_t rejected_grazing = 0;
  bool operator==(const CellStatistics&) const = default;
};

/// A local map seen from its origin: planes on a fixed lattice, no positions stored. Immutable once
/// built (hold it as `std::shared_ptr<const Cell>`: readers, caches and registration share it).
/// Planes and normals are in the cell frame, which is the sensor frame of the base scan.
struct Cell {
  LatticeSpec lattice;
  std::vector<std::uint32_t> indices;   ///< strictly increasing, < Lattice(lattice).size()
  std::vector<Plane> planes;            ///< planes[k] belongs to lattice point indices[k]
  std::string session;                  ///< which drive it came from
  std::uint32_t sequence = 0;           ///< position within the session, from 0
  Pose T_odom_cell = Pose::Identity();  ///< odometry pose it was born at; its current pose is the
                                        ///< pose graph's business
  Stamp first_stamp = 0;                ///< of the base scan
  Stamp last_stamp = 0;                 ///< of the last stacked scan
  std::uint32_t first_scan = 0;         ///< index of the base scan in the drive
  std::uint32_t scan_count = 0;         ///< number of stacked scans
  CellStatistics statistics;
};

/// 1 to 64 characters [A-Za-z0-9._-].
bool is_session_name(std::string_view name);

/// Throws Error{kCorruptData} naming the first broken rule: equal lengths, indices strictly
/// increasing and inside the lattice, planes finite, normals unit within 1e-3 and facing the
/// origin, distances in (0, 10,000] m, a rigid pose, a session name of 1 to 64 characters
/// [A-Za-z0-9._-], first_stamp <= last_stamp.
void validate(const Cell& cell);

/// The rules for one plane, whose lattice point `index` lies in `direction`. Throws as `validate`.
void validate_plane(const Plane& plane, const Eigen::Vector3d& direction, std::uint32_t index);

/// The rules of `validate` for planes alone, wherever they lie: everything on indices and planes.
/// About 6 ns a plane with AVX2.
void validate_planes(const LatticeSpec& lattice, std::span<const std::uint32_t> indices,
                     std::span<const Plane> planes);

/// The points distance * direction of every plane: the local map at one point a plane, cell frame.
PointCloud reconstruct_points(const Cell& cell, const Lattice& lattice);

}  // namespace cellmap
