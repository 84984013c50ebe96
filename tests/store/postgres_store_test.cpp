#include "cellmap/store/postgres_store.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <thread>
#include <vector>

#include "cellmap/store/open_store.hpp"
#include "cellmap/store/postgres_schema.hpp"
#include "cellmap/store/sql_claims.hpp"
#include "cellmap/store/sql_schema.hpp"
#include "cellmap/store/store_place.hpp"
#include "store/parts_contract.hpp"
#include "store/postgres_engine.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

StoreEngine postgres_engine() {
  return {"postgres", [](const std::filesystem::path& folder) -> std::unique_ptr<Store> {
            if (!postgres_address()) return nullptr;
            return open_postgres_store(postgres_address_for(folder));
          }};
}

INSTANTIATE_TEST_SUITE_P(Postgres, StoreContract, ::testing::Values(postgres_engine()));
INSTANTIATE_TEST_SUITE_P(Postgres, ClaimsContract, ::testing::Values(postgres_engine()));
INSTANTIATE_TEST_SUITE_P(Postgres, PartsContract, ::testing::Values(postgres_engine()));

class PostgresStoreTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!postgres_address()) GTEST_SKIP() << "no PostgreSQL server runs for this test";
    address_ = postgres_address_for(folder_.path());
  }

  std::unique_ptr<Store> open() const { return open_postgres_store(address_); }
  /// Ends the store's connections, as a server that restarts does, and waits until they have ended.
  void cut_connections() const {
    PostgresConnection connection(address_);
    connection.execute(
        "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity WHERE pid <> "
        "pg_backend_pid() "
        "AND application_name = 'cellmap-cut'");
  }

  TempFolder folder_;
  std::string address_;
};

TEST_F(PostgresStoreTest, WhatOneServerCommitsAnotherSeesAtOnce) {
  const auto a = open(), b = open();
  a->create_map("town", {});
  EXPECT_EQ(b->map("town").cells, 0u);
  const Revision revision = a->commit("town", adding({make_cell(1)})).revision;
  EXPECT_EQ(b->version("town").revision, revision);
  EXPECT_EQ(b->map("town").cells, 1u);  // also what is kept in memory by revision
  EXPECT_EQ(*b->stored_cell("town", {1}).frame, *a->stored_cell("town", {1}).frame);
  b->commit("town", moving({{CellId{1}, pose_at(3, 0)}}));
  EXPECT_EQ(a->pose_graph("town").nodes.at({1}).translation().x(), 3);
}

TEST_F(PostgresStoreTest, WhatAHashNamesIsRememberedAndWhatItDoesNotNameIsRead) {
  const auto store = open();
  store->create_map("town", {});
  const NewCell made = make_cell(1);
  const std::string hash = to_hex(made.encoded.hash);
  store->commit("town", adding({made}));
  EXPECT_FALSE(store->remembered_cell("town", {1}, hash));
  const StoredCell read = store->stored_cell("town", {1});
  const CurrentCell current = store->current_cell("town", {1});
  open()->commit("town", moving({{CellId{1}, pose_at(3, 0)}}));
  const auto remembered = store->remembered_cell("town", {1}, hash);
  if (!remembered) GTEST_SKIP() << "a minute ended between two lines of this test";
  EXPECT_EQ(*remembered->stored->frame, *read.frame);
  EXPECT_EQ(remembered->revision, current.revision);
  EXPECT_FALSE(store->remembered_cell("town", {1}, to_hex(make_cell(2).encoded.hash)));
  EXPECT_FALSE(store->remembered_cell("town", {2}, hash));
  EXPECT_FALSE(store->remembered_cell("other", {1}, hash));
  EXPECT_EQ(store->current_cell("town", {1}).record.T_map_cell.translation().x(), 3);
}

TEST_F(PostgresStoreTest, ServersThatWriteAtTheSameTimeLoseNothingAndLeaveNoGap) {
  open()->create_map("town", {});
  constexpr std::uint32_t kServers = 3, kCells = 20;
  std::vector<std::jthread> servers;
  for (std::uint32_t server = 0; server < kServers; ++server) {
    servers.emplace_back([&, server] {
      const auto store = open();
      const std::string session = "robot" + std::to_string(server);
      for (std::uint32_t i = 0; i < kCells; ++i) {
        store->commit("town",
                      adding({make_cell(1 + server * kCells + i, Pose::Identity(), session)}));
      }
    });
  }
  servers.clear();
  const auto store = open();
  EXPECT_EQ(store->map("town").revision, kServers * kCells);
  EXPECT_EQ(store->map("town").cells, kServers * kCells);
  std::set<Revision> added;
  CellQuery all;
  all.limit = 1000;
  for (const CellRecord& cell : store->cells("town", all).cells) added.insert(cell.added);
  EXPECT_EQ(added.size(), kServers * kCells);
}

TEST_F(PostgresStoreTest, ALostConnectionIsMadeAnewByTheNextTransaction) {
  address_ += "&application_name=cellmap-cut";
  const auto store = open();
  store->create_map("town", {});
  store->commit("town", adding({make_cell(1)}));
  cut_connections();
  EXPECT_EQ(store->map("town").cells, 1u);
  store->commit("town", adding({make_cell(2)}));
  cut_connections();
  store->commit("town", adding({make_cell(3)}));
  EXPECT_EQ(store->map("town").cells, 3u);
}

TEST_F(PostgresStoreTest, AFailureThatWasNotWaitedForIsToldByCommitAndChangesNothing) {
  open();
  PostgresConnection connection(address_);
  const auto put = [&](std::int64_t id, std::int64_t job) {
    Query(connection,
          "INSERT INTO job_part (job, claim, first_sequence, first_scan, scan_count) "
          "VALUES (?, ?, 0, 0, 1)",
          job, id)
        .run();
  };
  const auto count = [&] { return connection.integer("SELECT COUNT(*) FROM job_part"); };
  connection.begin_write();
  put(1, 7);
  put(1, 7);  // the same key
  put(2, 7);
  EXPECT_TRUE(connection.in_transaction());
  expect_error(
      ErrorCode::kInternal, [&] { connection.execute("COMMIT"); }, "duplicate key");
  EXPECT_TRUE(connection.in_transaction());
  expect_error(
      ErrorCode::kInternal, [&] { connection.execute("COMMIT"); }, "rolled back");
  EXPECT_FALSE(connection.in_transaction());
  EXPECT_EQ(count(), 0);

  connection.begin_write();
  put(1, 8);
  connection.execute("SAVEPOINT write");
  put(1, 8);
  connection.execute("ROLLBACK TO write");  // also of what is not known to have failed
  put(2, 8);
  connection.execute("COMMIT");
  EXPECT_EQ(count(), 2);
}

TEST_F(PostgresStoreTest, AStatementThatWasNotPreparedBehindAFailureIsPreparedLater) {
  open();
  PostgresConnection connection(address_);
  const auto remove = [&] { Query(connection, "DELETE FROM job_part WHERE job = ?", 1u).run(); };
  for (int turn = 0; turn < 2; ++turn) {
    connection.begin_write();
    if (turn == 0) Query(connection, "SELECT 1 / ?", std::int64_t{0}).run();
    remove();
    if (turn == 0) {
      expect_error(
          ErrorCode::kInternal, [&] { connection.settle(); }, "division by zero");
      connection.execute("ROLLBACK");
    } else {
      EXPECT_NO_THROW(connection.execute("COMMIT"));
    }
  }
}

TEST_F(PostgresStoreTest, OfWritesThatShareATransactionAFailingOneTakesBackOnlyItsOwn) {
  const auto store = open();
  store->create_map("town", {});
  // Each a statement that fails in the database, between commits that must come to be.
  PostgresConnection(address_).execute(
      "ALTER TABLE cell ADD CONSTRAINT no_thirteens CHECK (id % 13 <> 0)");
  std::atomic<int> refused = 0;
  {
    std::vector<std::jthread> writers;
    for (std::uint32_t writer = 0; writer < 4; ++writer) {
      writers.emplace_back([&, writer] {
        for (std::uint32_t id = 1 + writer; id <= 60; id += 4) {
          try {
            store->commit("town", adding({make_cell(id)}));
          } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::kInternal);
            EXPECT_EQ(id % 13, 0u) << error.what();
            ++refused;
          }
        }
      });
    }
  }
  EXPECT_EQ(refused, 4);
  EXPECT_EQ(store->map("town").cells, 56u);
  EXPECT_EQ(store->pose_graph("town").nodes.size(), 56u);
  EXPECT_EQ(store->map("town").revision, 56u);
}

TEST_F(PostgresStoreTest, AnUpdateOfAnySizeIsTheSameSentTogetherAndOneByOne) {
  const auto together = open();
  const auto one_by_one = open_postgres_store(address_, {.one_by_one = true});
  MapUpdate update, moves;
  for (std::uint32_t id = 1; id <= 700; ++id) update.cells.push_back(make_cell(id, pose_at(id, 0)));
  for (std::uint32_t id = 2; id <= 700; ++id) {
    update.add_constraints.push_back(make_constraint(id - 1, id));
    moves.poses[{id}] = pose_at(id, 1);
  }
  update.add_constraints.push_back(update.add_constraints.front());  // the same again
  for (const auto& [store, map] : {std::pair(together.get(), "a"), {one_by_one.get(), "b"}}) {
    store->create_map(map, {});
    const CommitResult added = store->commit(map, update);
    EXPECT_EQ(added.constraint_ids.back(), added.constraint_ids.front());
    EXPECT_EQ(store->commit(map, update).revision, added.revision);  // nothing new
    store->commit(map, moves);
  }
  const PoseGraph a = together->pose_graph("a"), b = one_by_one->pose_graph("b");
  EXPECT_EQ(a.constraints.size(), 699u);
  EXPECT_EQ(a.constraints.size(), b.constraints.size());
  ASSERT_EQ(a.nodes.size(), 700u);
  ASSERT_EQ(b.nodes.size(), 700u);
  for (const auto& [id, pose] : a.nodes) EXPECT_EQ(pose.matrix(), b.nodes.at(id).matrix());
  EXPECT_EQ(together->map("a").encoded_bytes, together->map("b").encoded_bytes);
}

TEST_F(PostgresStoreTest, ADatabaseOfVersionFiveIsBroughtUpToDateAndItsJobsMayBeClaimed) {
  {
    PostgresConnection old(address_);
    old.execute("CREATE TABLE cellmap_schema (version BIGINT PRIMARY KEY)");
    for (std::int64_t step = 0; step < 5; ++step) {
      old.execute(in_postgres_words(sql_schema_steps()[step]).c_str());
      Query(old, "INSERT INTO cellmap_schema (version) VALUES (?)", step + 1).run();
    }
    old.execute(kJobsOfSchema5);
  }
  const auto store = open();
  expect_jobs_of_schema5(*store);
  store->create_map("town", {});
  EXPECT_EQ(store->commit("town", adding({make_cell(1)})).revision, 1u);
}

TEST_F(PostgresStoreTest, LeasesOutliveTheServerThatReadsThem) {
  auto a = open();
  JobRecord job;
  job.map = "town";
  job.kind = "merge";
  claims_of(*a).queue_job(job, true, nothing_same);
  ASSERT_TRUE(claims_of(*a).claim_job({.worker = "a", .lease = kLong}));
  a.reset();
  EXPECT_FALSE(claims_of(*open()).claim_job({.worker = "b"}));
}

TEST_F(PostgresStoreTest, ClaimsDoNotWaitForALargeCommitOfAnotherServer) {
  const auto store = open();
  JobRecord job;
  job.map = "town";
  job.kind = "merge";
  claims_of(*store).queue_job(job, true, nothing_same);
  PostgresConnection other(address_);
  other.begin_write();
  other.settle();
  const auto held = claims_of(*store).claim_job({.worker = "a", .lease = kLong});
  ASSERT_TRUE(held);
  EXPECT_TRUE(claims_of(*store).extend_claim(claim_of(*held), kLong));
  claims_of(*store).hand_back(claim_of(*held));
  EXPECT_TRUE(other.in_transaction());
  other.execute("ROLLBACK");
}

TEST_F(PostgresStoreTest, AJobIsNotTakenOverInTheMiddleOfAWriteForIt) {
  const auto a = open(), b = open();
  JobRecord record;
  record.map = "town";
  record.kind = "merge";
  claims_of(*a).queue_job(record, true, nothing_same);
  const HeldJob job =
      *claims_of(*a).claim_job({.worker = "a", .lease = std::chrono::milliseconds(1)});
  PostgresConnection writing(address_);
  writing.begin_write();
  require_claim(writing, claim_of(job));
  EXPECT_FALSE(claims_of(*b).claim_job({.worker = "b"})) << "its lease has ended, but it writes";
  const auto kept = claims_of(*a).extend_claim(claim_of(job), kLong);  // does not wait
  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->lease_ends, job.holder.lease_ends);
  writing.execute("COMMIT");
  EXPECT_TRUE(claims_of(*b).claim_job({.worker = "b"}));
}

TEST_F(PostgresStoreTest, ANewerSchemaIsRefused) {
  open();
  PostgresConnection(address_).execute("INSERT INTO cellmap_schema (version) VALUES (1000)");
  expect_error(
      ErrorCode::kUnsupported, [&] { open(); }, "1000");
}

TEST_F(PostgresStoreTest, DamagedBytesAreRecognised) {
  const auto store = open();
  store->create_map("town", {});
  store->commit("town", adding({make_cell(1)}));
  PostgresConnection(address_).execute("UPDATE blob SET frame = set_byte(frame, 20, 1)");
  expect_error(
      ErrorCode::kCorruptData, [&] { store->stored_cell("town", {1}); }, "damaged");
}

TEST_F(PostgresStoreTest, ATextThatIsNoUtf8IsRefusedAndNothingChanges) {
  const auto store = open();
  store->create_map("town", {});
  for (const std::string& text : {std::string("\xff\xfe"), std::string("a\0b", 3)}) {
    JobRecord job;
    job.map = "town";
    job.kind = "ingest";
    job.request_json = text;
    expect_error(ErrorCode::kInvalidArgument, [&] { store->create_job(job); });
  }
  EXPECT_TRUE(store->jobs().empty());
  EXPECT_NO_THROW(store->check_ready());
}

TEST_F(PostgresStoreTest, IsReadyWhileAnotherServerIsWriting) {
  const auto store = open();
  PostgresConnection other(address_);
  other.begin_write();
  other.settle();
  EXPECT_NO_THROW(store->check_ready());
  other.execute("ROLLBACK");
}

TEST(PostgresAddress, IsToldFromTheNameOfAFile) {
  EXPECT_EQ(store_file("maps.db"), "maps.db");
  EXPECT_EQ(store_file("sqlite:maps.db"), "maps.db");
  EXPECT_EQ(store_file("postgresql://db/maps"), std::nullopt);
  EXPECT_EQ(store_file("postgres://db/maps"), std::nullopt);
  expect_error(
      ErrorCode::kInvalidArgument, [] { store_file("mysql://u:secret@db/maps"); }, "mysql");
}

TEST(PostgresAddress, NobodyThereAndNonsenseAreToldWithoutThePassword) {
  try {
    open_postgres_store("postgresql://user:secret@127.0.0.1:1/maps");
    ADD_FAILURE() << "nobody listens at port 1";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kUnavailable);
    EXPECT_EQ(std::string(error.what()).find("secret"), std::string::npos);
  }
  expect_error(
      ErrorCode::kInvalidArgument, [] { open_postgres_store("postgresql://host:no-port/?what=1"); },
      "postgresql://");
}

TEST(PostgresSchema, IsThatOfSqliteInOtherWords) {
  EXPECT_EQ(in_postgres_words("CREATE TABLE blob (id INTEGER PRIMARY KEY AUTOINCREMENT, x REAL "
                              "NOT NULL, frame BLOB, name TEXT, n INTEGER) WITHOUT ROWID;"),
            "CREATE TABLE blob (id BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY, x DOUBLE "
            "PRECISION NOT NULL, frame BYTEA, name TEXT COLLATE \"C\", n BIGINT);");
}

}  // namespace
}  // namespace cellmap::test
