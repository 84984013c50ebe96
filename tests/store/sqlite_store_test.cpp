#include "cellmap/store/sqlite_store.hpp"

#include <gmock/gmock.h>
#include <sqlite3.h>

#include <fstream>
#include <iterator>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "store/older_schema.hpp"
#include "store/parts_contract.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;

StoreEngine sqlite_engine() {
  return {"sqlite",
          [](const fs::path& folder) { return open_sqlite_store(folder / "test.cellmap"); }};
}

INSTANTIATE_TEST_SUITE_P(Sqlite, StoreContract, ::testing::Values(sqlite_engine()));
INSTANTIATE_TEST_SUITE_P(Sqlite, ClaimsContract, ::testing::Values(sqlite_engine()));
INSTANTIATE_TEST_SUITE_P(Sqlite, PartsContract, ::testing::Values(sqlite_engine()));

std::string read_file(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Runs SQL on a database file, past the store.
void run_sql(const fs::path& file, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  char* message = nullptr;
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, &message), SQLITE_OK) << message;
  sqlite3_free(message);
  sqlite3_close(database);
}

class SqliteStoreTest : public ::testing::Test {
 protected:
  /// A store with a map "town" of some CELLs, closed.
  void make_store(std::uint32_t cells = 5, std::size_t byte_count = 200) {
    const auto store = open_sqlite_store(file_);
    store->create_map("town", {});
    for (std::uint32_t id = 0; id < cells; ++id) {
      store->commit("town", adding({make_cell(id, pose_at(id, 0), "drive", byte_count)}));
    }
    store->commit("town", joining({make_constraint(0, 1)}));
  }

  void expect_refused(ErrorCode code, const std::string& part) const {
    const std::string before = read_file(file_);
    expect_error(
        code, [&] { open_sqlite_store(file_); }, part);
    EXPECT_EQ(read_file(file_), before) << "a file that is refused must not be changed";
  }

  TempFolder folder_;
  const fs::path file_ = folder_ / "test.cellmap";
};

TEST_F(SqliteStoreTest, TheFileSaysWhatItIs) {
  make_store();
  const std::string head = read_file(file_).substr(0, 100);
  EXPECT_EQ(head.substr(0, 15), "SQLite format 3");
  EXPECT_EQ(head.substr(16, 2), std::string("\x40\x00", 2)) << "16 KiB pages";
  EXPECT_EQ(head.substr(18, 2), "\x02\x02") << "write-ahead log";
  EXPECT_EQ(head.substr(68, 4), "CELL");
  EXPECT_EQ(head[63], static_cast<char>(sqlite_schema_version()));
}

TEST_F(SqliteStoreTest, AFileThatIsNoStoreIsRefusedAndKept) {
  folder_.write("test.cellmap", std::string(50'000, 'x'));
  expect_refused(ErrorCode::kCorruptData, "no CELLmap store");
  folder_.write("test.cellmap", "SQL");
  expect_refused(ErrorCode::kCorruptData, "no CELLmap store");
  folder_.write("test.cellmap", std::string("SQLite format 3\0", 16) + std::string(9'000, 'x'));
  expect_refused(ErrorCode::kCorruptData, "no store at all");
}

TEST_F(SqliteStoreTest, AnotherProgramsDatabaseIsRefusedAndKept) {
  run_sql(file_, "CREATE TABLE bookmarks (url TEXT)");
  expect_refused(ErrorCode::kCorruptData, "no CELLmap store");
}

TEST_F(SqliteStoreTest, ANewerSchemaIsRefusedAndKept) {
  make_store();
  run_sql(file_, "PRAGMA user_version = 99");
  expect_refused(ErrorCode::kUnsupported, "version 99");
}

TEST_F(SqliteStoreTest, AStoreOfVersionTwoIsBroughtUpToDateWithAllThatItHolds) {
  make_store();
  run_sql(file_, std::string(kUndoSchema9) + kUndoSchema8 + kUndoSchema7 + kUndoSchema6 +
                     kUndoSchema5 + R"sql(
      DROP TABLE document;
      DROP INDEX pose_constraint_by_judged;
      ALTER TABLE pose_constraint DROP COLUMN weight;
      ALTER TABLE pose_constraint DROP COLUMN pinned;
      ALTER TABLE pose_constraint DROP COLUMN judged;
      ALTER TABLE cell DROP COLUMN scans;
      ALTER TABLE cell DROP COLUMN raw_points;
      ALTER TABLE cell DROP COLUMN voxel_points;
      ALTER TABLE map DROP COLUMN next_cell;
      ALTER TABLE map DROP COLUMN oldest;
      ALTER TABLE map DROP COLUMN latitude_deg;
      ALTER TABLE map DROP COLUMN longitude_deg;
      ALTER TABLE map DROP COLUMN height_m;
      ALTER TABLE map DROP COLUMN R_enu_map;
      PRAGMA user_version = 2)sql");
  const auto store = open_sqlite_store(file_);
  const PoseGraph graph = store->pose_graph("town");
  EXPECT_EQ(graph.nodes.size(), 5u);
  ASSERT_EQ(graph.constraints.size(), 1u);
  EXPECT_EQ(graph.constraints[0].weight, 1);
  EXPECT_FALSE(store->map("town").georeference);
  MapUpdate removal;
  removal.remove_sessions = {"drive"};
  store->commit("town", removal);
  EXPECT_EQ(store->map("town").cells, 0u);
  EXPECT_EQ(store->pose_graph("town").new_cell_id(), CellId{5});
}

TEST_F(SqliteStoreTest, JobsOfVersionFiveMayBeClaimed) {
  make_store();
  run_sql(file_, std::string(kUndoSchema9) + kUndoSchema8 + kUndoSchema7 + kUndoSchema6 +
                     kJobsOfSchema5 + "PRAGMA user_version = 5");
  const auto store = open_sqlite_store(file_);
  expect_jobs_of_schema5(*store);
  EXPECT_EQ(store->map("town").cells, 5u);
}

TEST_F(SqliteStoreTest, WhoOpensTheFileNeedNotWaitForLeasesOfAProcessThatIsGone) {
  {
    const auto store = open_sqlite_store(file_);
    JobRecord job;
    job.map = "town";
    job.kind = "merge";
    claims_of(*store).queue_job(job, true, nothing_same);
    ASSERT_TRUE(claims_of(*store).claim_job({.worker = "killed", .lease = kLong}));
  }
  const auto store = open_sqlite_store(file_);
  const auto job = claims_of(*store).claim_job({.worker = "next", .lease = kLong});
  ASSERT_TRUE(job);
  EXPECT_EQ(job->holder.claim, 2u);
}

TEST_F(SqliteStoreTest, AnEmptyFileBecomesAStore) {
  folder_.write("test.cellmap", "");
  EXPECT_NO_THROW(open_sqlite_store(file_)->check_ready());
}

TEST_F(SqliteStoreTest, PathsThatCannotHoldAStoreAreRefused) {
  expect_error(
      ErrorCode::kIo, [&] { open_sqlite_store(folder_ / "none/test.cellmap"); }, "folder");
  expect_error(
      ErrorCode::kIo, [&] { open_sqlite_store(folder_.path()); }, "expected a file");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_sqlite_store(""); }, "name of a file");
}

TEST_F(SqliteStoreTest, ATruncatedFileIsRefused) {
  make_store(20, 30'000);
  const auto size = fs::file_size(file_);
  for (const auto kept : {size / 2, size - 1, std::uintmax_t{16'384}, std::uintmax_t{99}}) {
    const fs::path cut = folder_ / ("cut" + std::to_string(kept));
    fs::copy_file(file_, cut);
    fs::resize_file(cut, kept);
    expect_error(
        ErrorCode::kCorruptData,
        [&] {
          const auto store = open_sqlite_store(cut);
          for (const CellRecord& cell : store->cells("town", {}).cells) {
            store->compressed_cell("town", cell.id);
          }
        },
        "store");
  }
}

/// Everything that can be read of "town".
void read_everything(const Store& store) {
  store.maps();
  for (const CellRecord& cell : store.cells("town", {}).cells) {
    store.compressed_cell("town", cell.id);
  }
  store.nearest("town", {0, 0, 0}, 5);
  store.pose_graph("town");
  store.pose_graph("town", 2);
  store.changes("town", 1);
  store.scans("town", "drive");
  store.jobs();
}

TEST_F(SqliteStoreTest, DamagedBytesAreErrorsAndNeverWrongContent) {
  make_store(12, 30'000);
  const std::string whole = read_file(file_);
  std::mt19937 random(5);
  int noticed = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::string damaged = whole;
    // Half the trials hit a page as a whole, half one run of bytes, never the header.
    const std::size_t length = trial % 2 ? 16'384 : 16;
    const std::size_t at = trial % 2 ? 16'384 * (1 + random() % (whole.size() / 16'384 - 1))
                                     : 100 + random() % (whole.size() - 200);
    for (std::size_t i = at; i < at + length; ++i) damaged[i] = static_cast<char>(random());
    fs::remove(file_.string() + "-wal");
    std::ofstream(file_, std::ios::binary) << damaged;
    try {
      const auto store = open_sqlite_store(file_);
      read_everything(*store);
      for (std::uint32_t id = 0; id < 12; ++id) {
        const auto frame = store->compressed_cell("town", {id});
        EXPECT_EQ(zstd_decompress(*frame, 30'000),
                  make_cell(id, pose_at(id, 0), "drive", 30'000).encoded.bytes);
      }
    } catch (const Error& error) {
      ++noticed;
      EXPECT_TRUE(error.code() == ErrorCode::kCorruptData || error.code() == ErrorCode::kNotFound ||
                  error.code() == ErrorCode::kUnsupported)
          << to_string(error.code()) << ": " << error.what();
    }
  }
  EXPECT_GT(noticed, 30);
}

TEST_F(SqliteStoreTest, ASecondWriterIsRefusedUnderAnyName) {
  const auto store = open_sqlite_store(file_);
  expect_error(
      ErrorCode::kUnavailable, [&] { open_sqlite_store(file_); }, "open for writing",
      std::to_string(getpid()));
  fs::create_symlink(file_, folder_ / "link");
  expect_error(
      ErrorCode::kUnavailable, [&] { open_sqlite_store(folder_ / "link"); }, "open for writing");
  fs::create_directory_symlink(folder_.path(), folder_ / "way");
  expect_error(
      ErrorCode::kUnavailable, [&] { open_sqlite_store(folder_ / "way/test.cellmap"); },
      "open for writing");
}

TEST_F(SqliteStoreTest, AClosedStoreCanBeOpenedAgain) {
  for (int time = 0; time < 3; ++time) EXPECT_NO_THROW(open_sqlite_store(file_)->check_ready());
}

TEST_F(SqliteStoreTest, ReadersBesideTheWriterSeeWhatWasCommittedLast) {
  SqliteStoreOptions read_only;
  read_only.read_only = true;
  expect_error(
      ErrorCode::kNotFound, [&] { open_sqlite_store(file_, read_only); }, "does not exist");
  make_store();
  const auto writer = open_sqlite_store(file_);
  const auto reader = open_sqlite_store(file_, read_only);
  const Revision before = reader->map("town").revision;
  writer->commit("town", adding({make_cell(100)}));
  EXPECT_EQ(reader->map("town").revision, before + 1);
  EXPECT_EQ(zstd_decompress(*reader->compressed_cell("town", {100}), 1000),
            make_cell(100).encoded.bytes);
  EXPECT_NO_THROW(reader->check_ready());
  expect_error(
      ErrorCode::kUnsupported, [&] { reader->commit("town", adding({make_cell(101)})); },
      "read-only");
  expect_error(
      ErrorCode::kUnsupported, [&] { reader->create_map("b", {}); }, "read-only");
}

TEST_F(SqliteStoreTest, AReaderAloneWorksAfterTheWriterHasGone) {
  make_store();
  SqliteStoreOptions read_only;
  read_only.read_only = true;
  const auto reader = open_sqlite_store(file_, read_only);
  EXPECT_EQ(reader->map("town").cells, 5u);
  folder_.write("empty.cellmap", "");
  expect_error(
      ErrorCode::kUnsupported, [&] { open_sqlite_store(folder_ / "empty.cellmap", read_only); },
      "empty");
}

TEST_F(SqliteStoreTest, DeletingAMapFreesItsBytesForTheNext) {
  const auto store = open_sqlite_store(file_);
  const auto fill = [&](const std::string& map) {
    store->create_map(map, {});
    for (std::uint32_t id = 0; id < 40; ++id) {
      store->commit(map, adding({make_cell(id, pose_at(id, 0), map, 50'000)}));
    }
  };
  fill("first");
  store->delete_map("first");
  SqliteConnection connection(file_, SqliteAccess::kReadOnly, 1000);
  EXPECT_EQ(connection.integer("SELECT COUNT(*) FROM blob"), 0);
  const std::int64_t pages = connection.integer("PRAGMA page_count");
  EXPECT_GT(connection.integer("PRAGMA freelist_count"), pages * 8 / 10);
  fill("second");
  EXPECT_LT(connection.integer("PRAGMA page_count"), pages * 12 / 10);
}

TEST_F(SqliteStoreTest, EqualContentIsKeptOnce) {
  const auto store = open_sqlite_store(file_);
  for (const char* map : {"a", "b"}) {
    store->create_map(map, {});
    store->commit(map, adding({make_cell(1)}));
  }
  SqliteConnection connection(file_, SqliteAccess::kReadOnly, 1000);
  EXPECT_EQ(connection.integer("SELECT COUNT(*) FROM blob"), 1);
  store->delete_map("a");
  EXPECT_EQ(connection.integer("SELECT COUNT(*) FROM blob"), 1);
  store->delete_map("b");
  EXPECT_EQ(connection.integer("SELECT COUNT(*) FROM blob"), 0);
}

TEST_F(SqliteStoreTest, PlacesAreFoundThroughTheGridIndexAlone) {
  make_store();
  SqliteConnection connection(file_, SqliteAccess::kReadOnly, 1000);
  Query plan(connection,
             "EXPLAIN QUERY PLAN SELECT cell.id, cell.x, cell.y, cell.z FROM cell "
             "WHERE cell.map = 1 AND cell.gx = 0 AND cell.gy BETWEEN 0 AND 1");
  ASSERT_TRUE(plan.next());
  EXPECT_THAT(plan.text(3), ::testing::HasSubstr("COVERING INDEX cell_by_place"));
}

TEST_F(SqliteStoreTest, OptionsAreChecked) {
  SqliteStoreOptions options;
  options.max_readers = 0;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_sqlite_store(file_, options); }, "reader");
}

TEST_F(SqliteStoreTest, APartThatWasDamagedInTheFileIsRecognisedAndRemoved) {
  const auto store = open_sqlite_store(file_);
  JobRecord record;
  record.map = "town";
  record.kind = "ingest";
  claims_of(*store).queue_job(record, true, nothing_same);
  const HeldJob job = *claims_of(*store).claim_job({.worker = "holder", .lease = kLong});
  const JobPart part{claim_of(job), 0, 0, 10};
  Parts& parts = parts_of(*store);
  parts.offer_parts({part});
  ASSERT_TRUE(parts.take_part(job.record.id, "a"));
  ASSERT_TRUE(parts.deliver_part(part, "a", some_bytes(100)));
  dynamic_cast<SqlStore&>(*store).change_tables([](SqlConnection& connection) {
    connection.execute("UPDATE job_part SET made = zeroblob(100)");
  });
  expect_error(
      ErrorCode::kCorruptData, [&] { parts.collect_part(part); }, "damaged");
  EXPECT_TRUE(parts.offered_parts(part.claim).empty());
}

}  // namespace
}  // namespace cellmap::test
