#include "cellmap/simulation/town_object.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/simulation/random.hpp"

namespace cellmap::simulation {
namespace {

using Point = Eigen::Vector3d;

constexpr double kBelowGround_m = 1.5;  // walls reach down so that no gap opens on a slope

/// One wall of a building as a plane with its own axes: `at(u, z, out)` is u metres along it, z
/// metres up and `out` metres in front of it.
struct WallFrame {
  Point start;
  Point along;
  Point outward;
  double length_m;
  Point at(double u, double z, double out = 0) const {
    return start + u * along + out * outward + z * Point::UnitZ();
  }
};

/// A wall panel with an opening sunk into it (out < 0) or a bay in front of it (out > 0).
void panel(MeshBuilder& builder, const WallFrame& wall, double u0, double u1, double z0, double z1,
           double margin_u, double sill, double lintel, double out) {
  const double a = u0 + margin_u, b = u1 - margin_u, low = z0 + sill, high = z1 - lintel;
  builder.quad(wall.at(u0, z0), wall.at(a, z0), wall.at(a, z1), wall.at(u0, z1));
  builder.quad(wall.at(b, z0), wall.at(u1, z0), wall.at(u1, z1), wall.at(b, z1));
  builder.quad(wall.at(a, z0), wall.at(b, z0), wall.at(b, low), wall.at(a, low));
  builder.quad(wall.at(a, high), wall.at(b, high), wall.at(b, z1), wall.at(a, z1));
  builder.quad(wall.at(a, low, out), wall.at(b, low, out), wall.at(b, high, out),
               wall.at(a, high, out));
  builder.quad(wall.at(a, low), wall.at(b, low), wall.at(b, low, out), wall.at(a, low, out));
  builder.quad(wall.at(a, high), wall.at(b, high), wall.at(b, high, out), wall.at(a, high, out));
  builder.quad(wall.at(a, low), wall.at(a, high), wall.at(a, high, out), wall.at(a, low, out));
  builder.quad(wall.at(b, low), wall.at(b, high), wall.at(b, high, out), wall.at(b, low, out));
}

void plain_wall(MeshBuilder& builder, const WallFrame& wall, double z0, double z1) {
  builder.quad(wall.at(0, z0), wall.at(wall.length_m, z0), wall.at(wall.length_m, z1),
               wall.at(0, z1));
}

/// How the openings of a building look; one style a building.
struct FacadeStyle {
  double axis_m, storey_m, plinth_m, window_width_m, window_height_m, recess_m;
  double blind, bay;  // shares of panels
  static FacadeStyle draw(Random& random) {
    FacadeStyle style;
    style.axis_m = random.uniform(2.4, 4.2);
    style.storey_m = random.uniform(2.8, 3.6);
    style.plinth_m = random.uniform(0.3, 1.1);
    style.window_width_m = style.axis_m * random.uniform(0.35, 0.65);
    style.window_height_m = style.storey_m * random.uniform(0.4, 0.6);
    style.recess_m = random.uniform(0.12, 0.35);
    style.blind = random.uniform(0.05, 0.4);
    style.bay = random.chance(0.4) ? random.uniform(0.05, 0.25) : 0.0;
    return style;
  }
};

/// The space in front of a house's walls, within its footprint, that bays and eaves may use.
constexpr double kProjection_m = 0.8;

void facade(MeshBuilder& builder, const WallFrame& wall, double height_m, const FacadeStyle& style,
            Random& random) {
  const int columns = static_cast<int>(wall.length_m / style.axis_m);
  const int storeys = static_cast<int>((height_m - style.plinth_m) / style.storey_m);
  if (columns < 1 || storeys < 1) return plain_wall(builder, wall, -kBelowGround_m, height_m);
  const double axis = wall.length_m / columns;
  const double top = style.plinth_m + storeys * style.storey_m;
  plain_wall(builder, wall, -kBelowGround_m, style.plinth_m);
  if (top < height_m) plain_wall(builder, wall, top, height_m);
  const double margin = std::max(0.2, (axis - style.window_width_m) / 2);
  for (int column = 0; column < columns; ++column) {
    const bool bay = random.chance(style.bay);
    for (int storey = 0; storey < storeys; ++storey) {
      const double u0 = column * axis, u1 = u0 + axis;
      const double z0 = style.plinth_m + storey * style.storey_m, z1 = z0 + style.storey_m;
      const bool door = storey == 0 && random.chance(0.15);
      if (random.chance(style.blind)) {
        builder.quad(wall.at(u0, z0), wall.at(u1, z0), wall.at(u1, z1), wall.at(u0, z1));
      } else if (bay && storey > 0) {
        panel(builder, wall, u0, u1, z0, z1, 0.25, 0.2, 0.2, kProjection_m - 0.05);
      } else {
        const double sill = door ? 0.0 : 0.5 * (style.storey_m - style.window_height_m);
        panel(builder, wall, u0, u1, z0, z1, margin, sill,
              style.storey_m - sill - style.window_height_m, -style.recess_m);
      }
    }
  }
}

/// A pitched or flat roof over [x0, x1] x [y0, y1] at height z, with its eaves.
void roof(MeshBuilder& builder, double x0, double x1, double y0, double y1, double z, bool pitched,
          Random& random) {
  const double eaves = pitched ? random.uniform(0.1, 0.5) : 0.0;
  if (!pitched) {
    const double parapet = random.uniform(0.2, 1.0);
    builder.quad({x0, y0, z - parapet}, {x1, y0, z - parapet}, {x1, y1, z - parapet},
                 {x0, y1, z - parapet});
    return;
  }
  const double middle = 0.5 * (y0 + y1), slope = random.uniform(0.5, 0.95);
  const double ridge = z + slope * 0.5 * (y1 - y0), low = z - slope * eaves;
  builder.quad({x0, y0 - eaves, low}, {x1, y0 - eaves, low}, {x1, middle, ridge},
               {x0, middle, ridge});
  builder.quad({x0, y1 + eaves, low}, {x1, y1 + eaves, low}, {x1, middle, ridge},
               {x0, middle, ridge});
  builder.triangle({x0, y0, z}, {x0, y1, z}, {x0, middle, ridge});
  builder.triangle({x1, y0, z}, {x1, y1, z}, {x1, middle, ridge});
}

/// A row of one to three volumes of different depth and height, so that its fronts are stepped.
void add_house(const TownObject& house, MeshBuilder builder, bool detailed) {
  Random random(house.seed);
  const Eigen::Vector2d half =
      house.footprint.half_extent - Eigen::Vector2d::Constant(kProjection_m);
  const int volumes = half.x() > 6 ? random.integer(1, 3) : random.integer(1, 2);
  const FacadeStyle style = FacadeStyle::draw(random);
  double x0 = -half.x();
  for (int k = 0; k < volumes; ++k) {
    const double left = half.x() - x0;
    const double x1 =
        k + 1 == volumes ? half.x() : x0 + left / (volumes - k) * random.uniform(0.75, 1.25);
    const double depth = 2 * half.y();
    const double y0 = -half.y() + (random.chance(0.5) ? random.uniform(0.0, 0.2) * depth : 0.0);
    const double y1 = half.y() - (random.chance(0.5) ? random.uniform(0.0, 0.2) * depth : 0.0);
    const double height = house.height_m * (k == 0 ? 1.0 : random.uniform(0.55, 1.0));
    const std::array<WallFrame, 4> walls = {{
        {{x0, y0, 0}, Point::UnitX(), -Point::UnitY(), x1 - x0},
        {{x0, y1, 0}, Point::UnitX(), Point::UnitY(), x1 - x0},
        {{x0, y0, 0}, Point::UnitY(), -Point::UnitX(), y1 - y0},
        {{x1, y0, 0}, Point::UnitY(), Point::UnitX(), y1 - y0},
    }};
    for (std::size_t i = 0; i < walls.size(); ++i) {
      const bool inside = (i == 2 && k > 0) || (i == 3 && k + 1 < volumes);
      if (detailed && !inside) {
        facade(builder, walls[i], height, style, random);
      } else {
        plain_wall(builder, walls[i], -kBelowGround_m, height);
      }
    }
    roof(builder, x0, x1, y0, y1, height, random.chance(0.6), random);
    x0 = x1;
  }
}

void add_wall(const TownObject& wall, MeshBuilder builder) {
  Random random(wall.seed);
  const Eigen::Vector2d half = wall.footprint.half_extent;
  const double thickness = half.y() - 0.08;
  builder.box({-half.x(), -thickness, -kBelowGround_m}, {half.x(), thickness, wall.height_m});
  const double spacing = random.uniform(2.5, 5.0);
  for (double x = -half.x() + 0.2; x < half.x() - 0.2; x += spacing) {
    builder.box({x - 0.18, -half.y(), -kBelowGround_m}, {x + 0.18, half.y(), wall.height_m + 0.15});
  }
}

/// A long box whose sides and top are uneven.
void add_hedge(const TownObject& hedge, MeshBuilder builder) {
  Random random(hedge.seed);
  const Eigen::Vector2d half = hedge.footprint.half_extent;
  constexpr double step = 0.45, rough = 0.12;
  const int columns = std::max(2, static_cast<int>(2 * half.x() / step));
  const int rows = std::max(2, static_cast<int>(hedge.height_m / step));
  for (const double side : {-1.0, 1.0}) {
    std::vector<Point> grid;
    for (int row = 0; row <= rows; ++row) {
      for (int column = 0; column <= columns; ++column) {
        const double z = row == 0 ? -kBelowGround_m : hedge.height_m * row / rows;
        const double y = row == rows ? 0.35 * half.y() : half.y() - rough * random.uniform();
        grid.emplace_back(-half.x() + 2 * half.x() * column / columns, side * y,
                          z - (row == rows ? rough * random.uniform() : 0.0));
      }
    }
    const auto at = [&](int row, int column) {
      const int index = row * (columns + 1) + column;
      return grid[static_cast<std::size_t>(index)];
    };
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        builder.quad(at(row, column), at(row, column + 1), at(row + 1, column + 1),
                     at(row + 1, column));
      }
    }
  }
  builder.box({-half.x() + 0.1, -0.4 * half.y(), -kBelowGround_m},
              {half.x() - 0.1, 0.4 * half.y(), hedge.height_m - rough});
}

/// A trunk and a cloud of small leaves: rays are scattered by it and some pass through.
void add_tree(const TownObject& tree, MeshBuilder builder) {
  Random random(tree.seed);
  const double radius = tree.footprint.half_extent.minCoeff();
  const double crown_foot = tree.height_m * random.uniform(0.25, 0.4);
  const double girth = random.uniform(0.12, 0.28);
  builder.shaft({0, 0, -kBelowGround_m}, kBelowGround_m + tree.height_m * 0.6, girth, 0.5 * girth,
                7);
  const Point center(0, 0, 0.5 * (crown_foot + tree.height_m));
  const double leaf = 0.3;
  const Point reach(radius - leaf, radius - leaf, 0.5 * (tree.height_m - crown_foot) - 0.5 * leaf);
  const int leaves = static_cast<int>(70 * radius * radius);
  for (int k = 0; k < leaves; ++k) {
    const double z = random.uniform(-1, 1), azimuth = random.uniform(0, 2 * std::numbers::pi);
    const double ring = std::sqrt(1 - z * z), depth = std::cbrt(random.uniform(0.25, 1.0));
    const Point on_sphere(ring * std::cos(azimuth), ring * std::sin(azimuth), z);
    const Point middle = center + depth * reach.cwiseProduct(on_sphere);
    const Point u = Point(random.normal(), random.normal(), random.normal()).normalized();
    const Point v = u.unitOrthogonal();
    const double size = leaf * random.uniform(0.4, 0.7);
    builder.quad(middle - size * u, middle - size * v, middle + size * u, middle + size * v);
  }
}

/// A street lamp, a sign or a bare post.
void add_pole(const TownObject& pole, MeshBuilder builder) {
  Random random(pole.seed);
  const double radius = random.uniform(0.05, 0.11);
  builder.shaft({0, 0, -kBelowGround_m}, kBelowGround_m + pole.height_m, radius, 0.8 * radius, 8);
  const double reach = pole.footprint.half_extent.x();
  if (pole.height_m > 4.5) {
    builder.box({0, -0.06, pole.height_m - 0.15}, {reach, 0.06, pole.height_m});
    builder.box({0.5 * reach, -0.15, pole.height_m - 0.3}, {reach, 0.15, pole.height_m - 0.15});
  } else if (random.chance(0.7)) {
    builder.box({-reach, radius, pole.height_m - 0.8}, {reach, radius + 0.04, pole.height_m});
  }
}

Eigen::Isometry3d placement(const TownObject& object) {
  Eigen::Isometry3d T_world_object = Eigen::Isometry3d::Identity();
  T_world_object.linear() =
      Eigen::AngleAxisd(object.footprint.yaw_rad, Point::UnitZ()).toRotationMatrix();
  T_world_object.translation() << object.footprint.center, object.base_z_m;
  return T_world_object;
}

/// Length, width, height, height of the bonnet, and where the cabin begins and ends along x.
struct VehicleShape {
  double length_m, width_m, height_m, bonnet_m, cabin_back_m, cabin_front_m;
};

constexpr std::array<VehicleShape, kVehicleModels> kVehicles = {{
    {4.3, 1.78, 1.46, 0.85, -1.9, 0.75},  // hatchback
    {4.75, 1.84, 1.43, 0.9, -1.5, 0.6},   // saloon
    {4.6, 1.88, 1.68, 1.02, -2.1, 0.8},   // off-road
    {5.6, 2.0, 2.45, 1.15, -2.7, 1.75},   // van
}};

}  // namespace

Eigen::Vector2d vehicle_half_extent_m(int model) {
  const VehicleShape& shape = kVehicles[static_cast<std::size_t>(model)];
  return {0.5 * shape.length_m, 0.5 * shape.width_m};
}

void add_vehicle(int model, MeshBuilder builder) {
  const VehicleShape& shape = kVehicles[static_cast<std::size_t>(model)];
  const double x = 0.5 * shape.length_m, y = 0.5 * shape.width_m;
  const auto ring = [](double back, double front, double half_width, double z) {
    return std::array<Point, 4>{Point(back, -half_width, z), Point(front, -half_width, z),
                                Point(front, half_width, z), Point(back, half_width, z)};
  };
  builder.hexahedron(ring(-x + 0.1, x - 0.15, y - 0.05, 0.22), ring(-x, x, y, 0.55));
  builder.hexahedron(ring(-x, x, y, 0.55), ring(-x + 0.05, x - 0.25, y - 0.06, shape.bonnet_m));
  builder.hexahedron(
      ring(shape.cabin_back_m, shape.cabin_front_m, y - 0.08, shape.bonnet_m),
      ring(shape.cabin_back_m + 0.35, shape.cabin_front_m - 0.7, y - 0.25, shape.height_m));
  for (const double wheel_x : {-0.6 * x, 0.62 * x}) {
    for (const double side : {-1.0, 1.0}) {
      const double outer = side * (y - 0.01), inner = side * (y - 0.22);
      builder.box({wheel_x - 0.3, std::min(outer, inner), 0.0},
                  {wheel_x + 0.3, std::max(outer, inner), 0.6});
    }
  }
}

void add_object(const TownObject& object, TriangleMesh& mesh) {
  const MeshBuilder builder(mesh, placement(object));
  switch (object.kind) {
    case ObjectKind::kHouse:
      return add_house(object, builder, true);
    case ObjectKind::kBlock:
      return add_house(object, builder, false);
    case ObjectKind::kWall:
      return add_wall(object, builder);
    case ObjectKind::kHedge:
      return add_hedge(object, builder);
    case ObjectKind::kTree:
      return add_tree(object, builder);
    case ObjectKind::kPole:
      return add_pole(object, builder);
    case ObjectKind::kCar:
      return add_vehicle(static_cast<int>(object.seed % kVehicleModels), builder);
  }
}

}  // namespace cellmap::simulation
