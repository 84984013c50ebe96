#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "cellmap/simulation/ground.hpp"
#include "cellmap/simulation/ray_caster.hpp"
#include "cellmap/simulation/town_object.hpp"

namespace cellmap::simulation {

/// The town cut into square tiles whose triangles are made when the sensor comes near and dropped
/// when it has left: memory does not grow with the route. Not thread safe.
class TownTiles {
 public:
  TownTiles(const RayCaster& caster, const Ground& ground, const std::vector<TownObject>& objects);

  /// Every tile that anything within `range_m` of (x, y) may lie in, always in the same order.
  std::vector<RayCaster::Instance> around(double x, double y, double range_m);

 private:
  using Key = std::pair<std::int32_t, std::int32_t>;
  TriangleMesh make(const Key& key) const;

  const RayCaster& caster_;
  const Ground& ground_;
  std::map<Key, std::vector<TownObject>> objects_;
  std::map<Key, std::shared_ptr<const RayMesh>> built_;
};

}  // namespace cellmap::simulation
