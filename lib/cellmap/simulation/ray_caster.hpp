#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "cellmap/simulation/mesh.hpp"

namespace cellmap::simulation {

/// A mesh ready for ray casting. Immutable once built; knows its triangles.
class RayMesh;

/// Finds what rays hit first. Built on Embree, whose types stay in the source file.
class RayCaster {
 public:
  RayCaster();
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// Builds the search tree of `mesh`: about a third of a microsecond a triangle. Serial, so that
  /// the tree does not depend on the machine's load.
  std::shared_ptr<const RayMesh> build(TriangleMesh mesh) const;

  /// A mesh at a place.
  struct Instance {
    std::shared_ptr<const RayMesh> mesh;
    Eigen::Isometry3d T_world_mesh = Eigen::Isometry3d::Identity();
  };

  struct Hit {
    double range_m = 0;           ///< to the first surface; 0 where there is none
    double cosine_incidence = 0;  ///< between the ray and the surface's normal, 0 to 1
  };

  /// What each ray of unit `directions` (sensor frame) hits within `max_range_m` of the sensor,
  /// written to `hits`. The triangle is found in float, its distance computed in double. `threads`
  /// as `parallel_for` has it; the result does not depend on it.
  void cast(std::span<const Instance> instances, const Eigen::Isometry3d& T_world_sensor,
            std::span<const Eigen::Vector3f> directions, double max_range_m, int threads,
            std::span<Hit> hits) const;

 private:
  struct Device;
  std::unique_ptr<Device> device_;
};

/// The triangles of a built mesh.
const TriangleMesh& triangles_of(const RayMesh& mesh);

}  // namespace cellmap::simulation
