#include "cellmap/simulation/town.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/simulation/random.hpp"

namespace cellmap::simulation {
namespace {

/// The sign of the direction to the left that leads to that side of the street.
using Side = double;
constexpr Side kRight = -1, kLeft = 1;

/// Where parked cars begin.
constexpr double kerb_m(Side side) { return (side == kRight ? kClearRight_m : kClearLeft_m) + 0.3; }

/// Puts things beside the street where there is room, in the order asked: who comes first has the
/// place.
class Planner {
 public:
  Planner(const Centreline& line, const Ground& ground) : line_(line), ground_(ground) {
    for (double s = 0; s < line.length_m(); s += 2.0) taken_.insert(clear_strip(s));
    taken_.insert(clear_strip(line.length_m()));
  }

  /// A footprint beside the street at arc length `s`, its near edge `setback` from the driven line.
  Footprint beside(double s, Side side, double setback, const Eigen::Vector2d& half,
                   double yaw_jitter = 0) const {
    const Centreline::Point street = line_.at(s);
    return {street.position + side * (setback + half.y()) * street.left(),
            street.heading_rad + yaw_jitter, half};
  }

  /// Puts up an object if its place is free; `margin_m` keeps neighbours apart.
  bool place(ObjectKind kind, const Footprint& footprint, double height_m, std::uint64_t seed,
             double margin_m = 0.1) {
    Footprint wide = footprint;
    wide.half_extent.array() += margin_m;
    if (!taken_.is_free(wide)) return false;
    taken_.insert(footprint);
    objects_.push_back({kind, footprint, lowest_ground_m(kind, footprint), height_m, seed});
    return true;
  }

  double length_m() const { return line_.length_m(); }
  std::vector<TownObject> finish() { return std::move(objects_); }

 private:
  Footprint clear_strip(double s) const {
    const Centreline::Point street = line_.at(s);
    return {street.position + 0.5 * (kClearLeft_m - kClearRight_m) * street.left(),
            street.heading_rad,
            {1.5, 0.5 * (kClearLeft_m + kClearRight_m)}};
  }

  double lowest_ground_m(ObjectKind kind, const Footprint& footprint) const {
    const Eigen::Vector2d c = footprint.center;
    double lowest = ground_.height_or_zero_m(c.x(), c.y());
    if (kind == ObjectKind::kTree || kind == ObjectKind::kPole || kind == ObjectKind::kCar)
      return lowest;
    for (const double u : {-1.0, 1.0}) {
      const Eigen::Vector2d end = c + u * footprint.half_extent.x() * footprint.axis_x();
      lowest = std::min(lowest, ground_.height_or_zero_m(end.x(), end.y()));
    }
    return lowest;
  }

  const Centreline& line_;
  const Ground& ground_;
  FootprintIndex taken_;
  std::vector<TownObject> objects_;
};

struct BuildingRow {
  ObjectKind kind;
  double min_setback_m, max_setback_m;
  double min_half_width_m, max_half_width_m;
  double min_half_depth_m, max_half_depth_m;
  double min_height_m, max_height_m;
  double min_gap_m, max_gap_m;
  double open_share;  ///< of lots without a building
};

/// Walks along one side and builds on every lot that is free, smaller where a large one does not
/// fit.
void build_row(Planner& town, Side side, const BuildingRow& row, std::uint64_t seed) {
  Random random(seed);
  double s = random.uniform(0, 6);
  while (s < town.length_m()) {
    Eigen::Vector2d half(random.uniform(row.min_half_width_m, row.max_half_width_m),
                         random.uniform(row.min_half_depth_m, row.max_half_depth_m));
    const double setback = random.uniform(row.min_setback_m, row.max_setback_m);
    const double height = random.uniform(row.min_height_m, row.max_height_m);
    const double yaw = random.uniform(-0.07, 0.07);
    const double gap = random.uniform(row.min_gap_m, row.max_gap_m);
    const bool open = random.chance(row.open_share);
    const std::uint64_t details = random.next();
    bool built = false;
    for (int attempt = 0; attempt < 2 && !open && !built; ++attempt) {
      built = town.place(row.kind, town.beside(s + half.x(), side, setback, half, yaw), height,
                         details, 0.6);
      if (!built) half *= 0.65;
    }
    s += built || open ? 2 * half.x() + gap : 3.0;
  }
}

/// Garden walls and hedges between the pavement and the houses.
void build_boundaries(Planner& town, Side side, double pavement_m, std::uint64_t seed) {
  Random random(seed);
  for (double s = random.uniform(0, 10); s < town.length_m();) {
    const bool hedge = random.chance(0.5);
    const double length = random.uniform(4, 14), setback = pavement_m + random.uniform(0, 1.2);
    const Eigen::Vector2d half(0.5 * length, hedge ? random.uniform(0.35, 0.6) : 0.2);
    const double height = hedge ? random.uniform(0.8, 1.9) : random.uniform(0.7, 2.2);
    town.place(hedge ? ObjectKind::kHedge : ObjectKind::kWall,
               town.beside(s + half.x(), side, setback, half), height, random.next());
    s += length + random.uniform(1, 10);
  }
}

/// Trees along the kerb and in gardens.
void plant_trees(Planner& town, Side side, double near_m, std::uint64_t seed) {
  Random random(seed);
  for (double s = random.uniform(0, 12); s < town.length_m(); s += random.uniform(2, 10)) {
    const double radius = random.uniform(1.0, 2.8);
    const double setback = random.chance(0.5) ? near_m : random.uniform(near_m, near_m + 30);
    const double height = random.uniform(4.5, 10);
    const std::uint64_t details = random.next();
    for (const double size : {radius, 0.55 * radius}) {
      const Footprint crown = town.beside(s, side, setback, Eigen::Vector2d::Constant(size));
      if (town.place(ObjectKind::kTree, crown, height, details, 0)) break;
    }
  }
}

void set_poles(Planner& town, Side side, double near_m, std::uint64_t seed) {
  Random random(seed);
  for (double s = random.uniform(0, 15); s < town.length_m(); s += random.uniform(9, 26)) {
    const bool lamp = random.chance(0.5);
    const double quarter = 0.5 * std::numbers::pi;
    Footprint foot = town.beside(s, side, near_m, {lamp ? 0.5 : 0.35, lamp ? 0.2 : 0.16}, quarter);
    town.place(ObjectKind::kPole, foot, lamp ? random.uniform(5, 8) : random.uniform(2.2, 3.5),
               random.next(), 0);
  }
}

void park_cars(Planner& town, Side side, double near_m, std::uint64_t seed) {
  Random random(seed);
  for (double s = random.uniform(0, 6); s < town.length_m(); s += random.uniform(5.8, 8.5)) {
    const std::uint64_t details = random.next();
    const bool taken = random.chance(0.45);
    const double setback = near_m + random.uniform(0, 0.15), yaw = random.uniform(-0.03, 0.03);
    const double turned = random.chance(0.2) ? std::numbers::pi : 0.0;
    if (!taken) continue;
    const Eigen::Vector2d half = vehicle_half_extent_m(static_cast<int>(details % kVehicleModels));
    town.place(ObjectKind::kCar, town.beside(s, side, setback, half, yaw + turned), 2.5, details,
               0.1);
  }
}

}  // namespace

std::vector<TownObject> plan_town(const Centreline& line, const Ground& ground, std::uint64_t seed,
                                  std::uint64_t traffic_seed) {
  constexpr BuildingRow front = {ObjectKind::kHouse, 9.8, 17, 4.5, 11, 4, 7, 5, 15, 0.8, 9, 0.2};
  constexpr BuildingRow second = {ObjectKind::kHouse, 28, 44, 5, 13, 4.5, 9, 5, 16, 3, 16, 0.3};
  constexpr BuildingRow back = {ObjectKind::kBlock, 55, 100, 8, 18, 6, 14, 7, 22, 4, 20, 0.5};
  Planner town(line, ground);
  std::uint64_t part = 0;
  for (const BuildingRow& row : {front, second, back}) {
    for (const Side side : {kRight, kLeft}) build_row(town, side, row, sub_seed(seed, ++part));
  }
  for (const Side side : {kRight, kLeft}) {
    const double pavement = kerb_m(side) + 2.3;
    set_poles(town, side, pavement, sub_seed(seed, ++part));
    build_boundaries(town, side, pavement + 1.5, sub_seed(seed, ++part));
    plant_trees(town, side, pavement, sub_seed(seed, ++part));
  }
  // Last, so that nothing else depends on where cars are parked today.
  for (const Side side : {kRight, kLeft}) {
    park_cars(town, side, kerb_m(side), sub_seed(traffic_seed, ++part));
  }
  return town.finish();
}

}  // namespace cellmap::simulation
