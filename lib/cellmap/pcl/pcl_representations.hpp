#pragma once

#include <string>
#include <vector>

#include "cellmap/evaluation/representation.hpp"

namespace cellmap::pcl_io {

/// Means of voxels in PCL's octree compression, to `step_m` within a voxel.
Representation octree_compressed(double voxel_m, double step_m);

/// Means of voxels as Draco writes them at its smallest (k-d tree, speed 0), on a grid whose steps
/// are at most `step_m`.
Representation draco_compressed(double voxel_m, double step_m);

/// A mesh of triangles as binary PLY (12 bytes a vertex, 13 a triangle): Poisson reconstruction of
/// depth 10 over the means of 0.2 m voxels, for each 100 m driven, with normals towards the sensor,
/// without what is farther than 0.3 m from the points. What PUMA keeps.
Representation poisson_mesh();

/// All of these, as `cellmap compare` shows them.
std::vector<Representation> representations();

}  // namespace cellmap::pcl_io
