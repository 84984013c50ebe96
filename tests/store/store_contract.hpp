#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>

#include "cellmap/store/store.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {

/// A store engine under test. `open` opens the same store again when called again for a folder
/// whose store was closed, and gives null where the engine is not installed.
struct StoreEngine {
  std::string name;
  std::function<std::unique_ptr<Store>(const std::filesystem::path& folder)> open;
};

inline void PrintTo(const StoreEngine& engine, std::ostream* stream) { *stream << engine.name; }

/// What every engine must do. The tests are in contract_*_test.cpp; an engine joins by
/// INSTANTIATE_TEST_SUITE_P(Name, StoreContract, testing::Values(engine)).
class StoreContract : public ::testing::TestWithParam<StoreEngine> {
 protected:
  StoreContract() : store_(GetParam().open(folder_.path())) {}

  void SetUp() override {
    if (!store_) GTEST_SKIP() << "no " << GetParam().name << " server runs for this test";
  }

  void reopen() {
    store_.reset();
    store_ = GetParam().open(folder_.path());
  }

  TempFolder folder_;
  std::unique_ptr<Store> store_;
};

inline Pose pose_at(double x, double y, double z = 0, double yaw_rad = 0) {
  Pose pose = Pose::Identity();
  pose.translation() = Eigen::Vector3d(x, y, z);
  pose.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return pose;
}

/// A CELL whose bytes only have to be told apart: a store does not look into them. They follow from
/// id and session, so that a test can make them again and compare.
inline NewCell make_cell(std::uint32_t id, const Pose& T_map_cell = Pose::Identity(),
                         const std::string& session = "drive", std::size_t byte_count = 200) {
  auto cell = std::make_shared<Cell>();
  cell->session = session;
  cell->sequence = id;
  cell->indices = {3, 5, 8};
  cell->planes.assign(3, Plane{10, 0, 0, 1});
  cell->T_odom_cell = T_map_cell;
  NewCell made;
  made.id = {id};
  made.T_map_cell = T_map_cell;
  std::mt19937_64 random(id * 1000003ull + std::hash<std::string>()(session));
  made.encoded.bytes.resize(byte_count);
  for (std::byte& byte : made.encoded.bytes) byte = static_cast<std::byte>(random());
  made.encoded.hash = sha256(made.encoded.bytes);
  made.scans = {{100 + id, Pose::Identity()}, {200 + id, pose_at(1, 0.25, 0, 0.1)}};
  made.raw_points = 1000;
  made.cell = std::move(cell);
  return made;
}

inline Constraint make_constraint(std::uint32_t from, std::uint32_t to,
                                  ConstraintKind kind = ConstraintKind::kBidirectional) {
  Constraint constraint;
  constraint.from = {from};
  constraint.to = {to};
  constraint.kind = kind;
  constraint.origin = ConstraintOrigin::kDetection;
  constraint.T_from_to = pose_at(to - 1.0 * from, 0.1, 0.01, 0.3);
  constraint.information = Tangent(1, 2, 3, 4, 5, 6).asDiagonal();
  constraint.information(0, 5) = constraint.information(5, 0) = 0.125;
  constraint.scores = {1000, 900, 0.4, 0.9, 0.01, 0.02, 0.03};
  return constraint;
}

inline MapUpdate adding(std::vector<NewCell> cells) {
  MapUpdate update;
  update.cells = std::move(cells);
  return update;
}

inline MapUpdate moving(std::map<CellId, Pose> poses) {
  MapUpdate update;
  update.poses = std::move(poses);
  return update;
}

inline MapUpdate joining(std::vector<Constraint> constraints) {
  MapUpdate update;
  update.add_constraints = std::move(constraints);
  return update;
}

inline std::vector<std::uint32_t> ids_of(const std::vector<CellRecord>& cells) {
  std::vector<std::uint32_t> ids;
  for (const CellRecord& cell : cells) ids.push_back(cell.id.value);
  return ids;
}

}  // namespace cellmap::test
