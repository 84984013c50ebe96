#include "cellmap/simulation/town.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <tuple>

#include "support/real_data.hpp"

namespace cellmap::simulation {
namespace {

/// Out along x and back beside it, three metres to the left of the first pass: both lanes of a
/// street, driven in both directions, with a bend between.
Route out_and_back() {
  Route route;
  const auto add = [&](double x, double y, double yaw) {
    StampedPose sample{static_cast<Stamp>(route.size()) * 100'000'000, Pose::Identity()};
    sample.pose.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    sample.pose.translation() << x, y, 0;
    route.push_back(sample);
  };
  for (int i = 0; i < 150; ++i) add(i, 0, 0);
  for (int i = 0; i < 40; ++i) {
    const double a = std::numbers::pi * 1.0 * i / 40;
    add(150 + 15 * std::sin(a), 15 - 15 * std::cos(a), a);
  }
  for (int i = 0; i < 40; ++i) add(150 - i, 30 - 27.0 * i / 40, std::numbers::pi + 0.6);
  for (int i = 0; i < 110; ++i) add(110 - i, 3, std::numbers::pi);
  return route;
}

/// How many of the object's vertices lie within the strip that every pass keeps clear, told by
/// distance along and across the route at each of its vertices: no rectangles involved.
std::size_t vertices_in_lane(const Centreline& line, const TownObject& object) {
  TriangleMesh mesh;
  add_object(object, mesh);
  std::size_t inside = 0;
  for (double s = 0; s <= line.length_m(); s += 0.5) {
    const Centreline::Point street = line.at(s);
    if ((street.position - object.footprint.center).norm() > 45) continue;
    const Eigen::Vector2d left = street.left(), ahead(left.y(), -left.x());
    for (const auto& v : mesh.vertices) {
      const Eigen::Vector2d offset = Eigen::Vector2d(v[0], v[1]) - street.position;
      const double across = offset.dot(left);
      inside +=
          std::abs(offset.dot(ahead)) < 0.3 && across > -kClearRight_m && across < kClearLeft_m;
    }
  }
  return inside;
}

void expect_lanes_clear(const Route& route, std::size_t at_least_objects) {
  const Centreline line(route);
  const Ground ground(line, 1.73, 1);
  const auto objects = plan_town(line, ground, 1, 1);
  EXPECT_GT(objects.size(), at_least_objects);
  for (const TownObject& object : objects) {
    EXPECT_EQ(vertices_in_lane(line, object), 0u) << "kind " << static_cast<int>(object.kind)
                                                  << " at " << object.footprint.center.transpose();
  }
}

TEST(Town, KeepsEveryDrivenLaneOfTheTownRouteClear) { expect_lanes_clear(town_route(10), 200); }

TEST(Town, KeepsBothLanesOfAStreetDrivenInBothDirectionsClear) {
  expect_lanes_clear(out_and_back(), 40);
}

TEST(Town, KeepsTheLanesOfARealRouteClear) {
  const auto file = test::real_data("kitti-trajectories/ground_truth/07.txt");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  expect_lanes_clear(route_from_file(file, PoseFrame::kAuto), 150);
}

TEST(Town, KeepsEveryPartOfAnObjectOnItsFootprint) {
  const Centreline line(town_route(10));
  const Ground ground(line, 1.73, 1);
  for (const TownObject& object : plan_town(line, ground, 3, 3)) {
    TriangleMesh mesh;
    add_object(object, mesh);
    ASSERT_FALSE(mesh.triangles.empty());
    const Footprint& foot = object.footprint;
    for (const auto& v : mesh.vertices) {
      const Eigen::Vector2d offset = Eigen::Vector2d(v[0], v[1]) - foot.center;
      ASSERT_LT(std::abs(offset.dot(foot.axis_x())), foot.half_extent.x() + 1e-3)
          << "kind " << static_cast<int>(object.kind);
      ASSERT_LT(std::abs(offset.dot(foot.axis_y())), foot.half_extent.y() + 1e-3)
          << "kind " << static_cast<int>(object.kind);
      ASSERT_TRUE(std::isfinite(v[2]));
    }
  }
}

TEST(Town, HasOtherParkedCarsOnAnotherDayAndTheSameRest) {
  const Centreline line(town_route(10));
  const Ground ground(line, 1.73, 1);
  const auto split = [&](std::uint64_t traffic_seed) {
    std::vector<std::tuple<int, double, double, std::uint64_t>> rest, cars;
    for (const TownObject& object : plan_town(line, ground, 1, traffic_seed)) {
      auto& list = object.kind == ObjectKind::kCar ? cars : rest;
      list.emplace_back(static_cast<int>(object.kind), object.footprint.center.x(),
                        object.footprint.center.y(), object.seed);
    }
    return std::pair(rest, cars);
  };
  const auto [rest_today, cars_today] = split(1);
  const auto [rest_other, cars_other] = split(2);

  EXPECT_EQ(rest_today, rest_other);
  EXPECT_NE(cars_today, cars_other);
  EXPECT_GT(cars_other.size(), 40u);
}

TEST(Ground, GivesOneHeightWherePassesOfARouteDisagree) {
  Route route = out_and_back();
  for (std::size_t i = 0; i < route.size(); ++i) {
    route[i].pose.translation().z() =
        0.8 * static_cast<double>(i) / static_cast<double>(route.size());
  }
  const Centreline line(route);
  const Ground ground(line, 1.73, 1);

  for (double x = 5; x < 100; x += 5) {
    const double first = *ground.height_m(x, 0), second = *ground.height_m(x, 3);
    EXPECT_NEAR(first, second, 0.05) << "at x = " << x;
  }
  double before = *ground.height_m(0, 0);
  for (double s = 1; s < line.length_m(); s += 1) {
    const Eigen::Vector2d p = line.at(s).position;
    const double here = *ground.height_m(p.x(), p.y());
    EXPECT_LT(std::abs(here - before), 0.05) << "the disagreement is spread, at s = " << s;
    before = here;
  }
  EXPECT_FALSE(ground.height_m(0, 5000).has_value());
}

TEST(TownRoute, IsAboutAKilometreWithRevisitsInTheSameDirectionAndACrossing) {
  const Centreline line(town_route(10));
  EXPECT_NEAR(line.length_m(), 1000, 60);
  double revisited_m = 0;
  bool crossed = false;
  for (double s = 0; s < line.length_m(); s += 1) {
    for (double earlier = 0; earlier < s - 60; earlier += 1) {
      const auto a = line.at(earlier), b = line.at(s);
      if ((a.position - b.position).norm() > 1.0) continue;
      const double turn =
          std::abs(std::remainder(a.heading_rad - b.heading_rad, 2 * std::numbers::pi));
      if (turn < 0.2) {
        revisited_m += 1;
        break;
      }
      crossed = crossed || std::abs(turn - std::numbers::pi / 2) < 0.2;
    }
  }
  EXPECT_GT(revisited_m, 150);
  EXPECT_TRUE(crossed);
}

}  // namespace
}  // namespace cellmap::simulation
