#include "cellmap/client/pull.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "client/fake_map.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::FakeMap;

/// Ten CELLs, 10 m apart along x; CELL 0 at 0 m.
class PullNear : public testing::Test {
 protected:
  PullNear() {
    for (std::uint32_t id = 0; id < 10; ++id) {
      map.add(id);
      map.place(id, 10.0 * id);
    }
  }

  PullReport pull(std::optional<double> x = {}, double radius_m = 0, std::uint64_t budget = 0) {
    PullOptions options;
    if (x) options.near = Eigen::Vector3d(*x, 0, 0);
    options.radius_m = radius_m;
    options.budget_bytes = budget;
    Client client(test::options_for(map.server));
    return pull_map(client, "m", folder.path(), options);
  }
  /// Ids of the CELLs whose files are there.
  std::vector<std::uint32_t> held() const {
    std::vector<std::uint32_t> ids;
    for (const auto& [id, entry] : map.cells) {
      if (std::filesystem::exists(mirror_cell_file(folder.path(), entry.cell.hash))) {
        ids.push_back(id.value);
      }
    }
    return ids;
  }
  std::uint64_t bytes_of_one() const { return map.cells.begin()->second.cell.bytes.size(); }

  using Ids = std::vector<std::uint32_t>;
  FakeMap map;
  test::TempFolder folder;
};

TEST_F(PullNear, OnlyCellsWithinTheRadiusAreFetchedButEveryPose) {
  const PullReport report = pull(30, 12);
  EXPECT_EQ(held(), (Ids{2, 3, 4}));
  EXPECT_EQ(report.fetched, 3u);
  EXPECT_EQ(report.held, 3u);
  EXPECT_EQ(report.cells, 10u);
  const Mirror mirror = read_mirror(folder.path());
  EXPECT_EQ(mirror.cells.size(), 10u);
  EXPECT_EQ(mirror.pose_graph.nodes.size(), 10u);
}

TEST_F(PullNear, ARobotThatDrivesOnGetsWhatIsNewAndKeepsWhatItHas) {
  pull(30, 12);
  map.batches.clear();
  EXPECT_EQ(pull(40, 12).fetched, 1u);
  EXPECT_EQ(map.batches, (std::vector<Ids>{{5}}));
  EXPECT_EQ(held(), (Ids{2, 3, 4, 5}));
  EXPECT_EQ(pull(30, 12).fetched, 0u);
}

TEST_F(PullNear, BeyondTheBudgetTheFurthestGoFirst) {
  pull(30, 12);
  const PullReport report = pull(60, 12, 4 * bytes_of_one());
  EXPECT_EQ(report.fetched, 3u);
  EXPECT_EQ(report.evicted, 2u);
  EXPECT_EQ(held(), (Ids{4, 5, 6, 7}));
  EXPECT_EQ(pull(60, 100, 2 * bytes_of_one()).held, 2u);
  EXPECT_EQ(held(), (Ids{5, 6}));  // as far as 7, and before it
  EXPECT_EQ(pull(60, 100, bytes_of_one() - 1).held, 0u);
}

TEST_F(PullNear, ACellThatALoopMovesNearIsFetched) {
  pull(30, 12);
  map.move(9, 35);
  EXPECT_EQ(pull(30, 12).fetched, 1u);
  EXPECT_EQ(held(), (Ids{2, 3, 4, 9}));
}

TEST_F(PullNear, APullOfAllAfterwardsFetchesOnlyTheRest) {
  pull(30, 12);
  EXPECT_EQ(pull().fetched, 7u);
  EXPECT_EQ(held().size(), 10u);
}

TEST_F(PullNear, OptionsThatMakeNoSenseAreRefused) {
  for (const auto& [x, radius, budget] : {std::tuple<std::optional<double>, double, int>{{}, 5, 0},
                                          {{}, 0, 5},
                                          {1, 0, 0},
                                          {1, -2, 0},
                                          {std::nan(""), 5, 0}}) {
    test::expect_error(ErrorCode::kInvalidArgument,
                       [&, x = x, radius = radius, budget = budget] { pull(x, radius, budget); });
  }
}

// --- Following ------------------------------------------------------------------------------

/// A map with a stream of its revisions, long polls, or neither, whose server can be away.
class Follow : public testing::Test {
 protected:
  Follow() {
    for (std::uint32_t id = 0; id < 3; ++id) map.add(id);
    options.first_delay = options.max_delay = std::chrono::milliseconds(10);
    options.on_pull = [this](const PullReport& report) {
      const std::lock_guard lock(mutex);
      reports.push_back(report);
      changed.notify_all();
    };
    options.on_away = [this](const Error&, std::chrono::milliseconds) {
      const std::lock_guard lock(mutex);
      ++away;
      changed.notify_all();
    };
  }
  ~Follow() override { stop(); }

  void start() {
    thread = std::jthread([this](std::stop_token token) {
      try {
        auto client_options = test::options_for(server);
        client_options.retry.attempts = 1;
        Client client(client_options);
        follow_map(client, "m", folder.path(), options, token);
      } catch (const Error& error) {
        const std::lock_guard lock(mutex);
        failure = error;
        changed.notify_all();
      }
    });
  }
  void stop() {
    thread.request_stop();
    if (thread.joinable()) thread.join();
  }

  template <typename Condition>
  ::testing::AssertionResult wait_until(const Condition& condition) {
    std::unique_lock lock(mutex);
    const bool met = changed.wait_for(lock, std::chrono::seconds(30), condition);
    return met ? ::testing::AssertionSuccess()
               : ::testing::AssertionFailure() << reports.size() << " reports, " << away << " away";
  }

  /// Changes the map and tells who waits.
  template <typename Change>
  void change(const Change& change) {
    const std::lock_guard lock(map_mutex);
    change();
    map_changed.notify_all();
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    std::unique_lock lock(map_mutex);
    if (is_away) return test::answer_problem(response, 503, "unavailable", "away");
    if (is_gone) return test::answer_problem(response, 404, "not-found", "no such map");
    if (request.path.ends_with("/events")) {
      if (!has_events) return test::answer_problem(response, 404, "not-found", "no resource");
      return stream(response);
    }
    if (request.has_param("wait_s")) {
      if (!has_wait) return test::answer_problem(response, 400, "invalid-argument", "wait_s?");
      ++long_polls;
      const auto since = std::stoull(request.get_param_value("since"));
      map_changed.wait_for(lock, std::chrono::seconds(1),
                           [&] { return is_away || is_gone || map.revision != since; });
    }
    map.answer(request, response);
  }

  void stream(httplib::Response& response) {
    ++streams;
    auto told = std::make_shared<std::optional<Revision>>();
    response.set_chunked_content_provider(
        "text/event-stream", [this, told](std::size_t, httplib::DataSink& sink) {
          std::unique_lock lock(map_mutex);
          map_changed.wait_for(lock, std::chrono::milliseconds(20),
                               [&] { return is_away || is_gone || *told != map.revision; });
          if (is_away || is_gone) {
            sink.done();
            return true;
          }
          std::string text = ": still here\n\n";
          if (*told != map.revision) {
            text = "event: revision\nid: " + std::to_string(map.revision) + "\ndata: " +
                   client::dump({{"map", "m"},
                                 {"revision", map.revision},
                                 {"created", client::to_rfc3339(map.created)}},
                                false) +
                   "\n\n";
            *told = map.revision;
          }
          return sink.write(text.data(), text.size());
        });
  }

  std::mutex map_mutex;
  std::condition_variable map_changed;
  FakeMap map;
  bool has_events = true, has_wait = true, is_away = false, is_gone = false;
  std::atomic<int> streams = 0, long_polls = 0;

  std::mutex mutex;
  std::condition_variable changed;
  std::vector<PullReport> reports;
  int away = 0;
  std::optional<Error> failure;

  test::TempFolder folder;
  FollowOptions options;
  test::FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    answer(request, response);
  }};
  std::jthread thread;
};

TEST_F(Follow, EveryChangeArrivesOverOneStream) {
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  EXPECT_EQ(reports[0].fetched, 3u);
  change([&] { map.move(1, 7); });
  ASSERT_TRUE(wait_until([&] { return reports.size() == 2; }));
  EXPECT_EQ(reports[1].moved, 1u);
  EXPECT_EQ(reports[1].fetched, 0u);
  change([&] { map.add(3); });
  ASSERT_TRUE(wait_until([&] { return reports.size() == 3; }));
  EXPECT_EQ(reports[2].fetched, 1u);
  EXPECT_EQ(streams, 1);
  stop();
  EXPECT_EQ(read_mirror(folder.path()).revision, map.revision);
}

TEST_F(Follow, WithoutAStreamItWaitsByLongPolls) {
  has_events = false;
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  change([&] { map.move(1, 7); });
  ASSERT_TRUE(wait_until([&] { return reports.size() == 2; }));
  EXPECT_GT(long_polls, 0);
  EXPECT_EQ(read_mirror(folder.path()).pose_graph.nodes.at(CellId{1}).translation().x(), 7);
}

TEST_F(Follow, AServerThatIsAwayIsWaitedForAndTheMirrorStaysGood) {
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  change([&] { is_away = true; });
  ASSERT_TRUE(wait_until([&] { return away >= 3; }));
  EXPECT_EQ(read_mirror(folder.path()).cells.size(), 3u);
  change([&] {
    is_away = false;
    map.add(3);
  });
  ASSERT_TRUE(wait_until([&] { return reports.size() == 2; }));
  EXPECT_EQ(reports[1].fetched, 1u);
}

TEST_F(Follow, AMapThatWasDeletedEndsItAndLeavesTheMirror) {
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  change([&] { is_gone = true; });
  ASSERT_TRUE(wait_until([&] { return failure.has_value(); }));
  EXPECT_EQ(failure->code(), ErrorCode::kNotFound);
  EXPECT_EQ(read_mirror(folder.path()).cells.size(), 3u);
}

TEST_F(Follow, AMapThatWasMadeAnewReplacesTheOldOne) {
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  change([&] {
    map.cells.clear();
    map.constraints.clear();
    map.revision = 0;
    map.created += 1'000'000'000;
    for (std::uint32_t id = 10; id < 13; ++id) map.add(id);  // the same revision as before
    map.add(13);
  });
  ASSERT_TRUE(wait_until([&] { return reports.size() == 2; }));
  EXPECT_TRUE(reports[1].started_over);
  EXPECT_EQ(read_mirror(folder.path()).cells.size(), 4u);
}

TEST_F(Follow, ARobotThatMovesIsGivenItsSurroundings) {
  for (std::uint32_t id = 0; id < 3; ++id) map.place(id, 100.0 * id);
  std::atomic<double> x = 0;
  options.where = [&] { return Eigen::Vector3d(x, 0, 0); };
  options.pull.radius_m = 10;
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  EXPECT_EQ(reports[0].fetched, 1u);
  x = 205;
  ASSERT_TRUE(wait_until([&] { return reports.size() == 2; }));
  EXPECT_EQ(reports[1].fetched, 1u);
  EXPECT_EQ(reports[1].held, 2u);
  stop();
}

TEST_F(Follow, AStopEndsItAtOnce) {
  start();
  ASSERT_TRUE(wait_until([&] { return reports.size() == 1; }));
  stop();
  EXPECT_FALSE(failure);
}

}  // namespace
}  // namespace cellmap
