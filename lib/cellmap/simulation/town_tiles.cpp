#include "cellmap/simulation/town_tiles.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace cellmap::simulation {
namespace {

constexpr double kTile_m = 96.0;
/// An object belongs to the tile of its centre and may reach this far out of it.
constexpr double kMargin_m = 24.0;
constexpr double kGroundStep_m = 2.0;

std::int32_t tile_index(double coordinate_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / kTile_m));
}

/// The ground of one tile as a grid; places without ground stay open.
void add_ground(const Ground& ground, double x0, double y0, TriangleMesh& mesh) {
  constexpr int steps = static_cast<int>(kTile_m / kGroundStep_m);
  std::vector<std::optional<std::uint32_t>> vertex;
  for (int row = 0; row <= steps; ++row) {
    for (int column = 0; column <= steps; ++column) {
      const double x = x0 + column * kGroundStep_m, y = y0 + row * kGroundStep_m;
      const std::optional<double> z = ground.height_m(x, y);
      vertex.emplace_back();
      if (!z) continue;
      vertex.back() = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(
          {static_cast<float>(x), static_cast<float>(y), static_cast<float>(*z)});
    }
  }
  for (int row = 0; row < steps; ++row) {
    for (int column = 0; column < steps; ++column) {
      const auto at = [&](int r, int c) {
        const int index = r * (steps + 1) + c;
        return vertex[static_cast<std::size_t>(index)];
      };
      const auto a = at(row, column), b = at(row, column + 1);
      const auto c = at(row + 1, column + 1), d = at(row + 1, column);
      if (!a || !b || !c || !d) continue;
      mesh.triangles.push_back({*a, *b, *c});
      mesh.triangles.push_back({*a, *c, *d});
    }
  }
}

}  // namespace

TownTiles::TownTiles(const RayCaster& caster, const Ground& ground,
                     const std::vector<TownObject>& objects)
    : caster_(caster), ground_(ground) {
  for (const TownObject& object : objects) {
    const Eigen::Vector2d& c = object.footprint.center;
    objects_[{tile_index(c.x()), tile_index(c.y())}].push_back(object);
  }
}

TriangleMesh TownTiles::make(const Key& key) const {
  TriangleMesh mesh;
  add_ground(ground_, key.first * kTile_m, key.second * kTile_m, mesh);
  const auto found = objects_.find(key);
  if (found == objects_.end()) return mesh;
  for (const TownObject& object : found->second) add_object(object, mesh);
  return mesh;
}

std::vector<RayCaster::Instance> TownTiles::around(double x, double y, double range_m) {
  const double reach = range_m + kMargin_m;
  std::vector<RayCaster::Instance> near;
  std::map<Key, std::shared_ptr<const RayMesh>> kept;
  for (std::int32_t i = tile_index(x - reach); i <= tile_index(x + reach); ++i) {
    for (std::int32_t j = tile_index(y - reach); j <= tile_index(y + reach); ++j) {
      const double dx = x - std::clamp(x, i * kTile_m, (i + 1) * kTile_m);
      const double dy = y - std::clamp(y, j * kTile_m, (j + 1) * kTile_m);
      auto built = built_.find({i, j});
      if (built != built_.end()) kept.insert(*built);
      if (dx * dx + dy * dy > reach * reach) continue;
      auto& mesh = kept[{i, j}];
      if (!mesh) mesh = caster_.build(make({i, j}));
      near.push_back({mesh, Eigen::Isometry3d::Identity()});
    }
  }
  built_ = std::move(kept);
  return near;
}

}  // namespace cellmap::simulation
