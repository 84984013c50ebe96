#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/cell_form.hpp"
#include "cellmap/evaluation/compared_drive.hpp"
#include "cellmap/geometry/triangle_mesh.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// A file of a map, as it would lie on a disk.
struct MapFile {
  std::string name;  ///< of a file, without folders
  Bytes bytes;
};
using MapFiles = std::vector<MapFile>;

/// A CELL of a map that was read back.
struct ReadCell {
  std::shared_ptr<const RegistrationTarget> target;
  Pose T_map_cell = Pose::Identity();
};

/// What a program has once it has read a map, map frame. How well it agrees with the stacked points
/// is measured on its surface where it says one, else on its points; scans are registered to CELLs
/// where there are some, else to points.
struct DecodedMap {
  PointCloud points;
  PointCloud normals;  ///< as many as points, or none where the files hold none
  TriangleMesh surface;
  std::vector<ReadCell> cells;
};

/// One way to keep a map. Both functions are deterministic but for the time they take.
struct Representation {
  std::string name;
  /// From scans and poses to the files, everything that it takes.
  std::function<MapFiles(const ComparedDrive&)> encode;
  std::function<DecodedMap(const MapFiles&)> decode;
};

/// A figure that somebody published and that is not measured here.
struct PublishedRow {
  std::string name, source;
  double bytes_per_m = 0;
};

/// Points of every scan as they came, as binary PCD (x, y, z as float); with `zstd_level`, that
/// file as a zstd frame.
Representation raw_points(std::optional<int> zstd_level = {});

/// Means of voxels as binary PCD.
Representation voxel_points(double voxel_m);

/// Means of voxels on a grid of `step_m`, which divides a voxel into whole steps: voxels in Morton
/// order as differences of their keys, then the place within, axis by axis, all as one zstd frame
/// of level 19. A cloud as small as few formats make it.
Representation quantised_voxels(double voxel_m, double step_m);

/// Discs: centre, normal and radius as seven floats, one for each voxel whose points lie in a
/// plane; what SuMa keeps, without its colour, confidence and time.
Representation surfels(double voxel_m);

/// CELLs as `Mapper` makes them, one file each, and their poses in one (pose_graph.fbs). `build`
/// and `lattice` as there.
Representation cells(const CellForm& form, double cell_distance_m, const CellBuildOptions& build,
                     const LatticeSpec& lattice);

}  // namespace cellmap
