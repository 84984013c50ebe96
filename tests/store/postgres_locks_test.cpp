#include <gtest/gtest.h>

#include <atomic>
#include <barrier>
#include <future>
#include <thread>
#include <vector>

#include "cellmap/store/postgres_store.hpp"
#include "cellmap/store/sql_claims.hpp"
#include "cellmap/store/sql_contents.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/sql_writes.hpp"
#include "store/claims_contract.hpp"
#include "store/postgres_engine.hpp"
#include "store/shared_contents.hpp"
#include "support/expect_error.hpp"

// Who waits for whom where several servers write to one database. No test looks at a clock: a
// transaction stays open until something else has happened, or is seen waiting.

namespace cellmap::test {
namespace {

class PostgresLocksTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!postgres_address()) GTEST_SKIP() << "no PostgreSQL server runs for this test";
    address_ = postgres_address_for(folder_.path());
    name_ =
        "cellmap-" + std::to_string(std::hash<std::string>()(folder_.path().string()) % 1000000);
    a_ = open();
    b_ = open();
    a_->create_map("town", {});
    a_->create_map("village", {});
  }

  std::unique_ptr<Store> open() const {
    return open_postgres_store(address_ + "&application_name=" + name_);
  }
  static const SqlStore& sql(const Store& store) { return dynamic_cast<const SqlStore&>(store); }
  std::int64_t asked(const std::string& question) const {
    return PostgresConnection(address_).integer(question.c_str());
  }
  /// Returns when one of the stores' statements waits for a lock.
  void await_waiting() const {
    PostgresConnection watcher(address_);
    const std::string waiting =
        "SELECT COUNT(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND "
        "application_name = '" +
        name_ + "'";
    for (int i = 0; watcher.integer(waiting.c_str()) == 0; ++i) {
      if (i == 20'000) return ADD_FAILURE() << "nobody waits";
    }
  }
  std::int64_t contents_without_cell() const {
    return asked(
        "SELECT COUNT(*) FROM blob WHERE NOT EXISTS (SELECT 1 FROM cell WHERE cell.hash = "
        "blob.hash)");
  }

  TempFolder folder_;
  std::string address_, name_;
  std::unique_ptr<Store> a_, b_;
};

TEST_F(PostgresLocksTest, WhoWritesToAnotherMapDoesNotWait) {
  bool committed = false;
  sql(*a_).change_map("town", [&](SqlConnection&, const MapRow&) {
    EXPECT_EQ(b_->commit("village", adding({make_cell(1)})).revision, 1u);
    EXPECT_EQ(a_->commit("village", adding({make_cell(2)})).revision, 2u);  // from the same server
    SessionInfo session;
    session.name = "second";
    b_->create_session("village", session);
    b_->delete_map("village");
    committed = true;
  });
  EXPECT_TRUE(committed);
}

TEST_F(PostgresLocksTest, JobsGoOnWhileAMapIsWrittenTo) {
  JobRecord job;
  job.map = "town";
  job.kind = "ingest";
  job = claims_of(*a_).queue_job(job, true, nothing_same);
  sql(*a_).change_map("town", [&](SqlConnection&, const MapRow&) {
    job.cells_done = 7;
    b_->update_job(job);
    EXPECT_EQ(a_->job(job.id).cells_done, 7u);
  });
}

TEST_F(PostgresLocksTest, WhoWritesToTheSameMapWaitsAndLeavesNoGap) {
  std::future<Revision> second;
  sql(*a_).change_map("town", [&](SqlConnection& c, const MapRow& row) {
    EXPECT_EQ(row.info.revision, 0u);
    Query(c, "UPDATE map SET revision = 1 WHERE id = ?", row.key).run();
    c.settle();
    second = std::async(std::launch::async,
                        [&] { return b_->commit("town", adding({make_cell(1)})).revision; });
    await_waiting();
  });
  EXPECT_EQ(second.get(), 2u) << "it goes on from what it waited for";
}

TEST_F(PostgresLocksTest, WhoMakesAMapOrQueuesAJobWaitsForAllThatWrite) {
  std::atomic<bool> made = false;
  std::future<void> making;
  sql(*a_).change_map("town", [&](SqlConnection&, const MapRow&) {
    making = std::async(std::launch::async, [&] {
      b_->create_map("city", {});
      made = true;
    });
    await_waiting();
    EXPECT_FALSE(made);
  });
  making.get();
  EXPECT_EQ(a_->map("city").revision, 0u);
}

TEST_F(PostgresLocksTest, WhoWaitedForAMapThatWasDeletedDoesNotFindIt) {
  a_->commit("town", adding({make_cell(1)}));
  std::future<CommitResult> late;
  sql(*a_).change_map("town", [&](SqlConnection& c, const MapRow& row) {
    remove_map(c, row.key);
    c.settle();
    late =
        std::async(std::launch::async, [&] { return b_->commit("town", adding({make_cell(2)})); });
    await_waiting();
  });
  expect_error(
      ErrorCode::kNotFound, [&] { late.get(); }, "town");
  EXPECT_EQ(asked("SELECT COUNT(*) FROM cell"), 0);
  EXPECT_EQ(asked("SELECT COUNT(*) FROM blob"), 0);
}

TEST_F(PostgresLocksTest, OfServersThatMakeOneMapOneDoes) {
  for (int turn = 0; turn < 10; ++turn) {
    const std::string name = "map" + std::to_string(turn);
    std::atomic<int> made = 0, refused = 0;
    {
      std::vector<std::jthread> servers;
      for (Store* const store : {a_.get(), b_.get(), a_.get(), b_.get()}) {
        servers.emplace_back([&, store] {
          try {
            store->create_map(name, {});
            ++made;
          } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::kAlreadyExists) << error.what();
            ++refused;
          }
        });
      }
    }
    EXPECT_EQ(made, 1);
    EXPECT_EQ(refused, 3);
  }
}

TEST_F(PostgresLocksTest, AContentThatOneMapLeavesWhileAnotherTakesItIsThere) {
  a_->commit("town", adding({make_cell(1)}));
  std::future<CommitResult> taking;
  sql(*a_).change_map("town", [&](SqlConnection& c, const MapRow& row) {
    remove_map(c, row.key);  // the last to name it
    c.settle();
    taking = std::async(std::launch::async,
                        [&] { return b_->commit("village", adding({make_cell(1)})); });
    await_waiting();
  });
  EXPECT_EQ(taking.get().revision, 1u);
  EXPECT_EQ(open()->stored_cell("village", {1}).hash, make_cell(1).encoded.hash);
}

TEST_F(PostgresLocksTest, AContentThatOneMapTakesWhileAnotherLeavesItStays) {
  a_->commit("town", adding({make_cell(1)}));
  std::future<void> leaving;
  sql(*a_).change_map("village", [&](SqlConnection& c, const MapRow&) {
    const ContentHash hash = make_cell(1).encoded.hash;
    hold_contents(c, {{hash, {}}}, {{hash, 0}}, {});
    leaving = std::async(std::launch::async, [&] { b_->delete_map("town"); });
    await_waiting();
    Query(c,
          "INSERT INTO cell SELECT (SELECT id FROM map WHERE name = 'village'), id, hash, session, "
          "sequence, planes, encoded_bytes, added, moved, x, y, z, rotation, gx, gy, scans, "
          "raw_points, voxel_points, encoding, bound_um, identity, source, replaced FROM cell")
        .run();
  });
  leaving.get();
  EXPECT_EQ(open()->stored_cell("village", {1}).hash, make_cell(1).encoded.hash);
  EXPECT_EQ(asked("SELECT COUNT(*) FROM blob"), 1);
}

TEST_F(PostgresLocksTest, AContentThatTwoMapsLeaveAtOnceGoes) {
  a_->commit("town", adding({make_cell(1)}));
  a_->commit("village", adding({make_cell(1)}));
  std::future<void> other;
  sql(*a_).change_map("town", [&](SqlConnection& c, const MapRow& row) {
    remove_map(c, row.key);
    c.settle();
    other = std::async(std::launch::async, [&] { b_->delete_map("village"); });
    await_waiting();
  });
  other.get();
  EXPECT_EQ(asked("SELECT COUNT(*) FROM blob"), 0);
}

TEST_F(PostgresLocksTest, MapsThatTakeAndLeaveTheSameContentsAtRandomLoseAndForgetNone) {
  const auto c = open();
  race_for_contents({a_.get(), b_.get(), c.get(), a_.get(), b_.get(), c.get()}, 25);
  EXPECT_EQ(contents_without_cell(), 0);
  for (int i = 0; i < 6; ++i) a_->delete_map("m" + std::to_string(i));
  EXPECT_EQ(asked("SELECT COUNT(*) FROM blob"), 0);
}

TEST_F(PostgresLocksTest, ACircleIsBrokenAndEachChangeCarriedOutOnce) {
  std::vector<JobId> jobs;
  for (int i = 0; i < 2; ++i) {
    JobRecord job;
    job.map = "town";
    job.kind = "ingest";
    jobs.push_back(a_->create_job(job).id);
  }
  std::barrier both(2);
  const auto write = [&](const Store& store, const char* map, JobId first, JobId second) {
    bool is_first_time = true;
    sql(store).change_map(map, [&](SqlConnection& c, const MapRow& row) {
      const auto lock = [&](JobId job) {
        Query held(c, "SELECT id FROM job WHERE id = ? FOR UPDATE", job.value);
        EXPECT_TRUE(held.next());
      };
      Query(c, "UPDATE map SET revision = revision + 1 WHERE id = ?", row.key).run();
      lock(first);
      if (std::exchange(is_first_time, false)) both.arrive_and_wait();
      lock(second);  // against the order, as what shares a transaction may be
    });
  };
  std::jthread other([&] { write(*b_, "village", jobs[1], jobs[0]); });
  write(*a_, "town", jobs[0], jobs[1]);
  other.join();
  EXPECT_EQ(a_->version("town").revision, 1u);
  EXPECT_EQ(a_->version("village").revision, 1u);
}

TEST_F(PostgresLocksTest, ManyServersThatWriteToManyMapsLeaveNoGap) {
  constexpr std::uint32_t kCells = 15;
  const auto c = open();
  std::vector<std::jthread> robots;
  std::uint32_t robot = 0;
  for (Store* const store : {a_.get(), b_.get(), c.get()}) {
    for (const char* const map : {"town", "village"}) {
      robots.emplace_back([=, session = "robot" + std::to_string(robot)] {
        for (std::uint32_t i = 0; i < kCells; ++i) {
          store->commit(map, adding({make_cell(1 + robot * kCells + i, pose_at(0, 0), session)}));
        }
      });
      ++robot;
    }
  }
  robots.clear();
  for (const char* const map : {"town", "village"}) {
    EXPECT_EQ(a_->version(map).revision, 3 * kCells);
    EXPECT_EQ(a_->map(map).cells, 3 * kCells);
    EXPECT_EQ(asked(std::string("SELECT COUNT(DISTINCT added) FROM cell WHERE map = (SELECT id "
                                "FROM map WHERE name = '") +
                    map + "')"),
              3 * kCells);
  }
}

}  // namespace
}  // namespace cellmap::test
