#include "cellmap/store/check_store.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <map>
#include <thread>

#include "cellmap/store/backup_store.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "codec/samples.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// A CELL whose bytes are a CELL's.
NewCell real_cell(std::uint32_t id) {
  Cell cell = random_cell(id, 30, 1000);
  cell.session = "drive";
  cell.sequence = id;
  NewCell made = make_cell(id, pose_at(id * 6.0, 0));
  made.cell = std::make_shared<const Cell>(cell);
  made.encoded = encode_cell(cell);
  return made;
}

class CheckStore : public ::testing::Test {
 protected:
  CheckStore() {
    const auto store = open_sqlite_store(file_);
    store->create_map("town", real_cell(0).cell->lattice);
    for (std::uint32_t id = 0; id < 5; ++id) {
      MapUpdate update = adding({real_cell(id)});
      if (id > 0) update.add_constraints = {make_constraint(id - 1, id)};
      store->commit("town", update);
    }
    store->commit("town", moving({{{2}, pose_at(12, 1)}}));
  }

  void damage(const std::string& sql) {
    SqliteConnection connection(file_, SqliteAccess::kReadWrite, 0);
    connection.execute(sql.c_str());
  }
  std::vector<std::string> kinds() const {
    std::vector<std::string> kinds;
    for (const StoreFinding& finding : check_store(file_).findings) {
      kinds.emplace_back(to_string(finding.damage));
    }
    return kinds;
  }

  TempFolder folder_;
  std::filesystem::path file_ = folder_ / "store.db";
};

TEST_F(CheckStore, ASoundStoreIsIntactAlsoWhileItIsWritten) {
  const auto store = open_sqlite_store(file_);
  const StoreReport report = check_store(file_);
  EXPECT_THAT(report.findings, IsEmpty());
  EXPECT_THAT(report.notes, IsEmpty());
  EXPECT_EQ(report.maps, 1u);
  EXPECT_EQ(report.cells, 5u);
  EXPECT_EQ(report.contents, 5u);
}

struct Damage {
  const char* name;
  const char* sql;
  std::vector<std::string> kinds;  ///< of findings
  const char* lost;                ///< part of what a repair says to have lost; empty: nothing
};

void PrintTo(const Damage& damage, std::ostream* stream) { *stream << damage.name; }

class DamagedStore : public CheckStore, public ::testing::WithParamInterface<Damage> {};

TEST_P(DamagedStore, IsNoticedAndMendedAndWhatThatCostsIsSaid) {
  damage(GetParam().sql);
  EXPECT_EQ(kinds(), GetParam().kinds);
  const StoreRepair repair = repair_store(file_);
  EXPECT_THAT(kinds(), IsEmpty());
  const std::string lost = GetParam().lost;
  if (lost.empty()) {
    EXPECT_THAT(repair.lost, IsEmpty());
    EXPECT_FALSE(repair.done.empty());
  } else {
    EXPECT_THAT(repair.lost, testing::Contains(HasSubstr(lost)));
  }
  // And it can be used.
  const auto store = open_sqlite_store(file_);
  store->commit("town", adding({real_cell(7)}));
  EXPECT_EQ(store->pose_graph("town").nodes.size(), store->map("town").cells);
}

INSTANTIATE_TEST_SUITE_P(
    Each, DamagedStore,
    ::testing::Values(
        Damage{"SumOfCells", "UPDATE map SET cells = 9", {"count"}, ""},
        Damage{"SumOfConstraints", "UPDATE map SET constraints = 0", {"count"}, ""},
        Damage{"RevisionFellBack", "UPDATE map SET revision = 2", {"revision"}, ""},
        Damage{"PresentPoseNotInHistory", "UPDATE cell SET x = 99 WHERE id = 2", {"pose"}, ""},
        Damage{"FirstPoseMissing",
               "DELETE FROM cell_pose WHERE cell = 2 AND revision = 3",
               {"pose"},
               "poses that CELLs came with"},
        Damage{"SessionMissing",
               "PRAGMA foreign_keys = OFF; DELETE FROM session",
               {"drive", "drive", "drive", "drive", "drive"},
               "descriptions of sessions"},
        Damage{"ScansMissing",
               "DELETE FROM cell_scans WHERE cell = 3",
               {"drive"},
               "the scans of CELL 3 of map town"},
        Damage{"DescriptionOfNoCell",
               "PRAGMA foreign_keys = OFF; INSERT INTO cell_description (map, cell, hash, "
               "checksum, bytes) VALUES (1, 77, x'00', 0, x'00')",
               {"reference"},
               "1 descriptions without a CELL"},
        Damage{"DescriptionOfACellThatGoes",
               "PRAGMA foreign_keys = OFF; INSERT INTO cell_description (map, cell, hash, "
               "checksum, bytes) VALUES (1, 2, x'00', 0, x'00'); DELETE FROM blob WHERE hash = "
               "(SELECT hash FROM cell WHERE id = 2)",
               {"content"},
               "CELL 2 of map town"},
        Damage{"ConstraintToNowhere",
               "PRAGMA foreign_keys = OFF; UPDATE pose_constraint SET to_cell = 77 WHERE id = 1",
               {"reference"},
               "1 constraints to no CELL"},
        Damage{"BytesMissing",
               "PRAGMA foreign_keys = OFF; DELETE FROM blob WHERE hash = (SELECT hash FROM cell "
               "WHERE id = 2)",
               {"content"},
               "CELL 2 of map town"},
        Damage{"BytesDamaged",
               "UPDATE blob SET frame = CAST(substr(frame, 1, 20) || x'00ff00ff' || "
               "substr(frame, 25) AS BLOB) WHERE hash = (SELECT hash FROM cell WHERE id = 2)",
               {"content"},
               "CELL 2 of map town"},
        Damage{"UnusedBytes",
               "INSERT INTO blob (hash, encoded_bytes, checksum, frame) VALUES (x'00', 1, x'00', "
               "x'00')",
               {"unused"},
               "1 contents that no CELL had"}),
    [](const auto& info) { return info.param.name; });

TEST_F(CheckStore, BytesOfAnotherCellAreNoticedThoughTheirChecksumHolds) {
  damage(
      "UPDATE blob SET (frame, checksum) = (SELECT frame, checksum FROM blob WHERE hash = "
      "(SELECT hash FROM cell WHERE id = 1)) WHERE hash = (SELECT hash FROM cell WHERE id = 2)");
  EXPECT_THAT(kinds(), ElementsAre("content"));
}

TEST_F(CheckStore, ALostCellTakesItsConstraintsAndHistoryAlongAndItsNumberIsNotGivenAgain) {
  damage(
      "PRAGMA foreign_keys = OFF; DELETE FROM blob WHERE hash = (SELECT hash FROM cell WHERE "
      "id = 4)");
  repair_store(file_);
  const auto store = open_sqlite_store(file_);
  const PoseGraph graph = store->pose_graph("town");
  EXPECT_EQ(graph.nodes.size(), 4u);
  EXPECT_EQ(graph.constraints.size(), 3u);
  EXPECT_EQ(graph.new_cell_id(), CellId{5});
  expect_error(ErrorCode::kNotFound, [&] { store->pose_graph("town", 3); });
}

TEST_F(CheckStore, ADamagedPageIsFoundAndNotCalledRepaired) {
  std::string bytes;
  {
    std::ifstream in(file_, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  for (std::size_t i = 3 * 16384; i < 3 * 16384 + 200; ++i) bytes[i] = '\x5a';
  const auto broken = folder_.write("broken.db", bytes);
  const StoreReport report = check_store(broken);
  ASSERT_FALSE(report.findings.empty());
  EXPECT_EQ(report.findings.front().damage, StoreDamage::kFile);
  expect_error(ErrorCode::kCorruptData, [&] { repair_store(broken); });
}

TEST_F(CheckStore, ARepairWaitsForNobodyWhoWrites) {
  const auto store = open_sqlite_store(file_);
  expect_error(ErrorCode::kUnavailable, [&] { repair_store(file_); });
}

TEST_F(CheckStore, WhatIsNoStoreIsRefused) {
  expect_error(ErrorCode::kNotFound, [&] { check_store(folder_ / "nothing.db"); });
  expect_error(ErrorCode::kCorruptData,
               [&] { check_store(folder_.write("text.db", std::string(5000, 'x'))); });
}

TEST_F(CheckStore, ABackupOfAStoreThatIsWrittenIsOneOfItsRevisionsWhole) {
  const auto store = open_sqlite_store(file_);
  std::atomic<bool> stop = false;
  std::thread writer([&] {
    for (double y = 1; !stop; y += 0.001) {  // all CELLs by one step, so that a mixture would show
      std::map<CellId, Pose> poses;
      for (std::uint32_t id = 0; id < 5; ++id) poses[{id}] = pose_at(id * 6.0, y);
      store->commit("town", moving(poses));
    }
  });
  for (int i = 0; i < 5; ++i) {
    const auto copy = folder_ / ("backup" + std::to_string(i) + ".db");
    backup_store(file_, copy);
    EXPECT_THAT(check_store(copy).findings, IsEmpty());
    const PoseGraph graph = open_sqlite_store(copy)->pose_graph("town");
    for (const auto& [id, pose] : graph.nodes) {
      const double y = graph.nodes.at({0}).translation().y();
      EXPECT_TRUE(y == 0 || pose.translation().y() == y);
    }
  }
  stop = true;
  writer.join();
}

TEST_F(CheckStore, ABackupNeverReplacesAFileAndABrokenOffOneLeavesNone) {
  const auto there = folder_.write("there.db", "something");
  expect_error(ErrorCode::kAlreadyExists, [&] { backup_store(file_, there); });
  std::stop_source stop;
  stop.request_stop();
  const auto copy = folder_ / "copy.db";
  expect_error(ErrorCode::kCancelled, [&] { backup_store(file_, copy, stop.get_token()); });
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
    EXPECT_THAT(entry.path().filename().string(), testing::Not(testing::StartsWith("copy")));
  }
}

}  // namespace
}  // namespace cellmap::test
