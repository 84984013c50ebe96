#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/pose_graph/information.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// How far an odometry may be off between neighbouring CELLs, as standard deviations.
struct OdometryModel {
  double sigma_m_per_m = 0.02;    ///< translation, of the distance between the two
  double sigma_deg_per_m = 0.02;  ///< rotation, of the same distance
  double least_sigma_m = 0.02;    ///< however near they are
  double least_sigma_deg = 0.1;

  void validate() const;
};

struct MapperOptions {
  double cell_distance_m = 6.0;  ///< a new CELL begins strictly beyond this from the last base pose
  ScanFilterOptions filter;
  CellBuildOptions build;
  bool bidirectional = true;  ///< off: neighbours are tied by odometry alone
  RegistrationOptions registration = default_place_registration();  ///< of neighbouring CELLs
  AcceptanceOptions acceptance;  ///< of neighbouring CELLs; refused: the odometry constraint stays
  /// A registration of neighbours that moves them farther than this from their odometry is refused.
  double max_correction_m = 1.0;
  double max_correction_deg = 5.0;
  /// Points of each base scan that register neighbours; more cost time and gain nothing measurable.
  std::size_t registration_points = 40'000;
  OdometryModel odometry;
  /// What a registration of neighbours does not know of its own errors, on
  /// real drives about 8 cm and 0.13 deg.
  PoseSigma registration_floor;
  bool loop_closures = true;
  LoopOptions loops;
  PoseGraphOptions pose_graph;

  void validate() const;
};

/// Everything that one finished CELL changes in a map; a store commits it as one transaction.
struct CellUpdate {
  CellId id;
  std::shared_ptr<const Cell> cell;
  std::vector<ScanInCell> scans;        ///< the cell's stretch of the trajectory
  std::vector<Constraint> constraints;  ///< new, unnumbered
  std::map<CellId, Pose> poses;         ///< T_map_cell: of the new CELL and of all that moved
  std::uint64_t raw_points = 0;         ///< points of its scans before filtering
};

/// The online pipeline (paper, Sec. III-A): scans with odometry in, CELLs with constraints and
/// poses out. Reads as the paper's abstract. One owner; holds the pose graph, the current local map
/// and the previous base scan, never the scans of the past.
class Mapper {
 public:
  /// `graph` is the map as it stands (empty for a new one). `targets` hands out earlier CELLs.
  /// A new session starts at its odometry pose, moved by `T_map_odom`.
  Mapper(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice,
         PoseGraph graph, TargetProvider targets, const Pose& T_map_odom = Pose::Identity());

  ~Mapper();
  Mapper(Mapper&&) noexcept;

  /// Continues a session after its last stored CELL. `base_scan` is the (unfiltered) scan
  /// `last.first_scan` of the drive. The next scan to add is `last.first_scan + last.scan_count`.
  void resume_after(CellId id, std::shared_ptr<const Cell> last, const PosedScan& base_scan);

  /// Adds the next scan; returns the CELL that it completed, if it did.
  std::optional<CellUpdate> add(const PosedScan& scan);

  /// Ends the drive: the CELL of the scans since the last one, if there are any.
  std::optional<CellUpdate> finish();

  const PoseGraph& graph() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
