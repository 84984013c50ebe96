#pragma once

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/map/junction.hpp"
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
  /// Whether islands of the map are joined where a CELL of one is found in another.
  bool junctions = true;
  JunctionOptions junction;
  PoseGraphOptions pose_graph;

  void validate() const;
};

}  // namespace cellmap
