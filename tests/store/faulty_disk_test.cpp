#include "support/faulty_disk.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <optional>

#include "cellmap/store/documents.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "cellmap/store/staging.hpp"
#include "store/older_schema.hpp"
#include "store/store_contract.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kCellBytes = 40'000;  // several pages

/// Everything of a store that a write of these tests may change, as one text.
std::string state_of(const Store& store) {
  std::string state;
  for (const MapInfo& map : store.maps()) {
    state += map.name + " r" + std::to_string(map.revision) + " c" + std::to_string(map.cells) +
             " k" + std::to_string(map.constraints) + " b" + std::to_string(map.stored_bytes) +
             "\n";
    const PoseGraph graph = store.pose_graph(map.name);
    for (const auto& [id, pose] : graph.nodes) {
      state += std::to_string(id.value) + " " + std::to_string(pose.translation().x()) + " " +
               to_hex(sha256(*store.compressed_cell(map.name, id))) + "\n";
    }
    for (const Constraint& c : graph.constraints) {
      state += std::to_string(c.from.value) + "-" + std::to_string(c.to.value) + "\n";
    }
    for (const SessionInfo& session : store.sessions(map.name)) state += session.name + "\n";
  }
  for (const JobRecord& job : store.jobs()) state += std::string(to_string(job.state)) + "\n";
  return state;
}

struct Operation {
  const char* name;
  std::function<void(Store&)> run;
  std::string age{};  ///< SQL that makes the store an older one before
};

void PrintTo(const Operation& operation, std::ostream* stream) { *stream << operation.name; }

MapUpdate two_cells() {
  MapUpdate update = adding({make_cell(10, pose_at(60, 0), "drive", kCellBytes),
                             make_cell(11, pose_at(66, 0), "drive", kCellBytes)});
  update.add_constraints = {make_constraint(10, 11)};
  return update;
}

const std::vector<Operation> kOperations = {
    {"PutCells", [](Store& store) { store.commit("town", two_cells()); }},
    {"UpdatePoses",
     [](Store& store) {
       std::map<CellId, Pose> poses;
       for (std::uint32_t id = 0; id < 8; ++id) poses[{id}] = pose_at(id * 7.0, 1);
       store.commit("town", moving(poses));
     }},
    {"DeleteMap", [](Store& store) { store.delete_map("town"); }},
    {"DeleteSession",
     [](Store& store) {
       MapUpdate update;
       update.remove_sessions = {"drive"};
       store.commit("town", update);
     }},
    {"PublishStagedMap",
     [](Store& store) {
       StagedMap staged(store, {}, "village");
       store.commit(staged.name(), two_cells());
       staged.publish();
     }},
    {"CreateJob",
     [](Store& store) {
       JobRecord job;
       job.map = "town";
       job.kind = "ingest";
       job.request_json = "{}";
       store.create_job(job);
     }},
    {"Reopen", [](Store&) {}},
    {"Migrate", [](Store&) {},
     std::string(kUndoSchema9) + kUndoSchema8 + kUndoSchema7 + kUndoSchema6 + kUndoSchema5 +
         "DROP TABLE document; PRAGMA user_version = 3"},
};

/// Hundreds of stores are made and thrown away: in memory where there is such a folder, since some
/// disks take a while to forget a file.
class FolderInMemory {
 public:
  FolderInMemory() {
    if (fs::is_directory("/dev/shm")) setenv("TMPDIR", "/dev/shm", 1);
    folder_.emplace();
    before_ ? setenv("TMPDIR", before_->c_str(), 1) : unsetenv("TMPDIR");
  }
  fs::path operator/(const std::string& name) const { return *folder_ / name; }

 private:
  std::optional<std::string> before_ =
      std::getenv("TMPDIR") ? std::optional<std::string>(std::getenv("TMPDIR")) : std::nullopt;
  std::optional<TempFolder> folder_;
};

class FaultyStore : public ::testing::TestWithParam<std::tuple<Operation, Fault>> {
 protected:
  static const Operation& operation() { return std::get<0>(GetParam()); }
  static Fault fault() { return std::get<1>(GetParam()); }

  FaultyStore() {
    auto store = open_sqlite_store(prepared_);
    store->create_map("town", {});
    MapUpdate update;
    for (std::uint32_t id = 0; id < 8; ++id) {
      update.cells.push_back(make_cell(id, pose_at(id * 6.0, 0), "drive", kCellBytes));
      if (id > 0) update.add_constraints.push_back(make_constraint(id - 1, id));
    }
    store->commit("town", update);
    before_ = state_of(*store);
    store.reset();
    if (!operation().age.empty()) {
      SqliteConnection(prepared_, SqliteAccess::kReadWrite, 1000).execute(operation().age.c_str());
    }
  }

  /// A fresh store in the state before the operation.
  void prepare() {
    store_.reset();
    for (const char* const suffix : {"", "-wal", "-shm"}) fs::remove(file_.string() + suffix);
    fs::copy_file(prepared_, file_);
  }

  /// Opens the store, runs the operation, and says whether that failed.
  bool fails() {
    try {
      store_ = open_sqlite_store(file_);
      operation().run(*store_);
      return false;
    } catch (const Error& error) {
      const bool full = error.code() == ErrorCode::kDiskFull;
      EXPECT_TRUE(is_io(error.code())) << error.what();
      const bool broken = std::string(error.what()).find("check the disk") != std::string::npos;
      EXPECT_TRUE(fault() == Fault::kBrokenOnce ? broken : full || broken) << error.what();
      return true;
    }
  }

  void expect_sound() {
    EXPECT_EQ(SqliteConnection(file_, SqliteAccess::kReadOnly, 0).text("PRAGMA integrity_check"),
              "ok");
  }

  FolderInMemory folder_;
  FaultyDisk disk_;
  fs::path prepared_ = folder_ / "prepared.db", file_ = folder_ / "store.db";
  std::string before_, after_;
  std::unique_ptr<Store> store_;
};

/// The n-th thing that the disk is asked fails, for every n.
TEST_P(FaultyStore, AFailureIsToldAndChangesNothingAndTheNextOneWorks) {
  prepare();
  ASSERT_FALSE(fails());
  after_ = state_of(*store_);
  int failed = 0;
  for (int n = 1;; ++n) {
    SCOPED_TRACE("fault " + std::to_string(n));
    prepare();
    disk_.fail_at(n, fault());
    const bool told = fails();
    const bool happened = disk_.has_failed();
    disk_.heal();
    if (!happened) {
      EXPECT_FALSE(told);
      break;
    }
    failed += told;
    if (!store_) store_ = open_sqlite_store(file_);
    // A failed checkpoint or clean-up is made up for later: nobody has to be told.
    EXPECT_EQ(state_of(*store_), told ? before_ : after_);
    if (told) operation().run(*store_);
    EXPECT_EQ(state_of(*store_), after_);
    store_.reset();
    expect_sound();
    EXPECT_EQ(state_of(*open_sqlite_store(file_)), after_);
    if (HasFailure() || n > 500) FAIL() << "stopped at fault " << n;
  }
  EXPECT_GE(failed, 1) << "no fault reached the operation";
}

std::string name_of(const testing::TestParamInfo<std::tuple<Operation, Fault>>& info) {
  static constexpr const char* kFaults[] = {"FullDisk", "FullOnce", "BrokenOnce"};
  const auto& [operation, fault] = info.param;
  return std::string(operation.name) + "On" + kFaults[static_cast<int>(fault)];
}

INSTANTIATE_TEST_SUITE_P(Sqlite, FaultyStore,
                         ::testing::Combine(::testing::ValuesIn(kOperations),
                                            ::testing::Values(Fault::kFull, Fault::kFullOnce,
                                                              Fault::kBrokenOnce)),
                         name_of);

}  // namespace
}  // namespace cellmap::test
