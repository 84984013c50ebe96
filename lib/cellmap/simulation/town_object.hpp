#pragma once

#include <cstdint>

#include "cellmap/simulation/footprint.hpp"
#include "cellmap/simulation/mesh.hpp"

namespace cellmap::simulation {

enum class ObjectKind { kHouse, kBlock, kWall, kHedge, kTree, kPole, kCar };

/// One thing that stands in the town. Its shape follows from these few numbers, so that a town of
/// any length stays small in memory and its triangles are made where they are needed.
struct TownObject {
  ObjectKind kind = ObjectKind::kHouse;
  Footprint footprint;  ///< every part of it stays inside
  double base_z_m = 0;  ///< ground level it stands on
  double height_m = 0;
  std::uint64_t seed = 0;  ///< of its details
};

/// Adds the triangles of `object` to `mesh`, in the world frame.
void add_object(const TownObject& object, TriangleMesh& mesh);

/// Number of kinds of vehicle and the size that each fits in.
constexpr int kVehicleModels = 4;
Eigen::Vector2d vehicle_half_extent_m(int model);

/// A vehicle at the origin, x forward, standing on z = 0.
void add_vehicle(int model, MeshBuilder builder);

}  // namespace cellmap::simulation
